"""Identify an arm from measurements."""
