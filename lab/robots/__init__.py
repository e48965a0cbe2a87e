"""Robots by name or file, and what a run keeps of them."""
