"""Ages materials: per-texel BRDFs, their latents, temporal models and Torrance-Sparrow fits. No
bpy.
"""

__version__ = "0.1.0"
