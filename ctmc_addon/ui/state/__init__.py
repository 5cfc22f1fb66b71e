"""What is known during a session and not stored in the file."""
