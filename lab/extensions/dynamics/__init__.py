"""Identification of payloads and of an arm's own dynamics."""
