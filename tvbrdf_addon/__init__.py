"""Everything that touches bpy.  Never imports torch, never computes a BRDF."""
