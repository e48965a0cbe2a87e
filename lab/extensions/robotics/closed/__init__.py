"""Closed-form models of the 2-RPR, the 3-RPR and the Delta, after a course (Mallem 2011)."""
