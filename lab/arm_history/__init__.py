"""The dated runs of one arm: what changed between two of them, and since when."""
