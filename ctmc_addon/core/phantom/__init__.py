"""An abdominal CT with known truth."""
