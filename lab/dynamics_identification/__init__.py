"""The arm's own dynamic parameters, from torques along a path, with and without a load."""
