"""Sentences of checks, by the check's name; nothing is decided by a sentence."""
