"""Goodness of fit, outliers, model selection."""
