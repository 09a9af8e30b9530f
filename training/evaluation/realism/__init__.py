"""`evaluate realism`: whether what grows looks like what really grew."""
