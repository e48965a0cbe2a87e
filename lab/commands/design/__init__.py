"""`lab design`."""
