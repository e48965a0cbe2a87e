"""`lab import`."""
