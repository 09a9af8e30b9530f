"""Ages materials: per-texel BRDFs, their latents, temporal models and Torrance-Sparrow fits. No bpy."""
