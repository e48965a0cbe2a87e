"""`lab verify`."""
