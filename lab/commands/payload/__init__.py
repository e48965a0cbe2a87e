"""`lab payload`."""
