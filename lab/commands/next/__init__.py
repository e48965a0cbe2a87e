"""`lab next`."""
