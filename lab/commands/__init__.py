"""One folder a command."""
