"""`lab status`."""
