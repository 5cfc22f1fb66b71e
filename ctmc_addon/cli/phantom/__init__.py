"""`ctmc phantom`: a CT with known truth as files of the usual formats."""
