"""Identify the payload at the flange."""
