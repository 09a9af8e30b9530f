"""Reports: how well methods do, each a room of its own."""
