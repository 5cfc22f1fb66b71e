"""What the 3D viewport shows and lets the mouse move."""
