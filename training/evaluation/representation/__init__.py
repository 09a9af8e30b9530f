"""`evaluate representation`: how well BRDFs are held."""
