"""The rotation test of Su and Ma, 4.3: how long a surface takes to turn once."""
