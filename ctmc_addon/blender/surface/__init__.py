"""A surface as an object of the Blender file, and read back from it."""
