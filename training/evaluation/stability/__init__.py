"""`evaluate stability`: where methods fail, and whether the product notices."""
