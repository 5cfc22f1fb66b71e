"""Marching Cubes on voxels of any stride, in three passes."""
