"""Draw and print: pages, figures, recordings."""
