"""From maps to the histories of their texels, modelling no more of them than shows."""
