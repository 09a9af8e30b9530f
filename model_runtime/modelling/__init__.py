"""From maps to the histories of their texels, modeling no more of them than shows."""
