"""A budget by formula and by drawing: two inputs, one of them rectangular."""

import numpy as np

rng, draws = np.random.default_rng(0), 1_000_000
reading, scale, length = 5e-3, 10e-6, 600.0  # mm, relative limits of a rectangular distribution, mm
by_formula = np.hypot(reading, length * scale / np.sqrt(3))
drawn = reading * rng.standard_normal(draws) + length * rng.uniform(-scale, scale, draws)
print(f"combined standard uncertainty: formula {1e3 * by_formula:.2f} um, drawn {1e3 * drawn.std():.2f} um")
print(
    f"expanded (95 %): formula {1e3 * 1.96 * by_formula:.2f} um, drawn {1e3 * np.quantile(np.abs(drawn), 0.95):.2f} um"
)
