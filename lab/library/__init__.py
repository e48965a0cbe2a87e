"""The public functions: values in, values out."""
