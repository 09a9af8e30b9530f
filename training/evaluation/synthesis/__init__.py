"""`evaluate synthesis`: how well a change is carried over to another material."""
