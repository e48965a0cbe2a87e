"""`lab compare`."""
