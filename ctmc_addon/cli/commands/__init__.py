"""The commands that need one file: info, reconstruct, settings."""
