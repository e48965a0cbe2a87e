"""`lab certify`."""
