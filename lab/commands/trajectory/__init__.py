"""`lab trajectory`."""
