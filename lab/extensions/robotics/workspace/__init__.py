"""Where a robot brings its tool: reach, volume, boundary, voids, and in how many orientations."""
