"""Mechanisms with loops: structure, loop closure, derivatives."""
