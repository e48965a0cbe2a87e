"""`lab inspect`."""
