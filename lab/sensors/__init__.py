"""Sensors, one module each: model, derivative, columns, simulation and terms."""
