"""What one campaign is made of, for commands and studies: options, robot, virtual robot, poses to choose from."""
