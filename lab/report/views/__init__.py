"""The document, the figures and the recording of each result."""
