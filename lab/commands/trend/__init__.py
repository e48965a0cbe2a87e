"""`lab trend`."""
