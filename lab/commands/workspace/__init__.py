"""`lab workspace`."""
