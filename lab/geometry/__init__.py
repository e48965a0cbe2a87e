"""The arm as equations: chains, kinematics with derivatives, gauge."""
