"""Sentences of checks: the only place where numbers of tests become words."""
