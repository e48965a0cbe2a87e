"""Commands of the lab, one folder each."""
