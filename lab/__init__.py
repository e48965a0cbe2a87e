"""A virtual calibration lab for serial robots: plan, measure, identify, assess, show."""

__version__ = "0.1.0"
