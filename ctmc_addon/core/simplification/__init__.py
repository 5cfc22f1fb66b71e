"""Fewer triangles by quadric error metrics, to a count or within a distance."""
