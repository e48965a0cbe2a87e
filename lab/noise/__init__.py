"""Noise: instruments, and the terms of the errors that measured numbers share."""
