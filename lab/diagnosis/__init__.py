"""Diagnosis: name the mistake in measurements, before any noise model or effect explains it.

Read ``hypothesis`` first. ``gross`` compares discrete mistakes (units, signs, exchanges, shifts) where the nominal arm
misses the measurements by much; ``fine`` tests continuous ones (steps, zeros, range constant, scale, coupling) against
a marginal model of all that a sound campaign may hold, and refits the best few. Sensors bring their own hypotheses.
"""
