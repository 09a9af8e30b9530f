"""Live materials: textures and curves from which a shader computes any moment by itself."""
