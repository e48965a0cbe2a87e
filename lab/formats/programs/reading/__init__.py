"""Programs of controllers, read for the numbers of their targets: a module for each language."""
