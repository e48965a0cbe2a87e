"""What residuals say: outliers, adequacy, lag, rounding, and which groups of parameters the data support."""
