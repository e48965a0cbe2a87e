"""Direct, inverse and differential models, trajectories and workspaces of robots."""
