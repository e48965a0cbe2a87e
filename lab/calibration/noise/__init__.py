"""What the errors of measurements are made of: an instrument, joints that scatter, time, and heavy tails."""
