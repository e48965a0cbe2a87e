"""What an instrument reads of a virtual arm: one module for each kind of observation that is simulated."""
