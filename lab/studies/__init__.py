"""Studies of many campaigns: grid, executors, folder, analysis."""
