"""Choose the poses of a measurement session, in their surroundings."""
