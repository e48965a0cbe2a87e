"""Mechanisms with loops: their description, how they assemble, and the seam by which the rest of the lab sees them."""
