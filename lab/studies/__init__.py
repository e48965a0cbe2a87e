"""Many campaigns: grid, batches, executors, store, analysis."""
