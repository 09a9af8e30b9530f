"""Maps of the surface that shows a material: where it lies, what it faces, what shelters it."""
