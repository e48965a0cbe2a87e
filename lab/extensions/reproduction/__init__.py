"""Reproduce the tables, figures and worked examples of four published sources, item by item."""
