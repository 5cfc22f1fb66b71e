"""`ctmc experiment`: the experiments of Su and Ma on any CT."""
