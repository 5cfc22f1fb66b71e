"""Image slices: PNG, JPEG, BMP and TIFF."""
