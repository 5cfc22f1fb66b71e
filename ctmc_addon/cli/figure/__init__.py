"""`ctmc figure`: figures, sheets and turntables from one command."""
