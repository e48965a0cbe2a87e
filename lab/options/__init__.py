"""Options of what is simulated, of a fit, and of its judgement."""
