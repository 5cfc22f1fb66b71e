"""The operators `ctmc.*`, one subject a file."""
