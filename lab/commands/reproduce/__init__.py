"""`lab reproduce`."""
