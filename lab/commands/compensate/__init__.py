"""`lab compensate`."""
