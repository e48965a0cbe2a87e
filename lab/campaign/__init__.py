"""Parts of one campaign, for commands and studies: options, robot, virtual robot, design problem."""
