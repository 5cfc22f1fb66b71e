"""`ctmc batch`: a surface for each of many cases, one process a case."""
