"""Residual process: a Gaussian process of the joint positions, with its uncertainty."""
