"""`evaluate layers`: what films do to what lies under them, by random walks."""
