"""Commands of the lab: a module or a folder each."""
