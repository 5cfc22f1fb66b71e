"""Grey values on a grid, where they lie in the patient, and what is read from them before extraction."""
