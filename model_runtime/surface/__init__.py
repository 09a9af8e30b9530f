"""When each place of an object starts to age: growth over its surface, without Blender or torch."""
