"""The properties of scene, object and preferences."""
