"""A measuring day of torques in MuJoCo, for `lab payload --simulate` and `lab dynamics --simulate`."""
