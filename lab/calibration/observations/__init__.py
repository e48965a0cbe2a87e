"""Kinds of observation: points, poses, fixtures."""
