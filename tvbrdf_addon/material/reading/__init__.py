"""From a material in Blender to maps that the worker reads."""
