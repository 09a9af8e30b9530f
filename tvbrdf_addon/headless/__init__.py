"""`blender -b ... --command age_material`: materials aged without a window."""
