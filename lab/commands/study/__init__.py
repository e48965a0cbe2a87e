"""`lab study`."""
