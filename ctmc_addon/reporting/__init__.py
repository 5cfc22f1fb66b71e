"""Text and files that every front end writes."""
