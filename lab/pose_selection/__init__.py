"""Choose the poses to measure."""
