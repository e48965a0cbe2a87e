"""Error models of measurements: an instrument, joint scatter, drift in time, and heavy tails."""
