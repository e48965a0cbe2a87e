"""Parts of one campaign, for commands and studies: options, robot, virtual robot, candidate poses."""
