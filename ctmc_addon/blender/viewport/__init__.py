"""What is drawn over a 3D viewport and stored nowhere."""
