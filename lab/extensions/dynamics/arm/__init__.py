"""`lab dynamics`: identify the arm's own dynamic parameters."""
