"""What the sidebar draws."""
