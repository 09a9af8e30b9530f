"""Between Blender's materials and maps: reads and bakes them, binds aged ones, reverts, freezes."""
