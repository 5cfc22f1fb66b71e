"""The triangles of a surface, and what can be measured on them."""
