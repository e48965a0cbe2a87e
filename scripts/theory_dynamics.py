"""Torques of a two-link arm at rest are linear in its masses, but not in each of them alone."""

import numpy as np

gravity, first = 9.81, 0.4  # m/s^2, length of the first link in m
q1, q2 = np.random.default_rng(0).uniform(-3, 3, (2, 20))

# Columns: mass of the first link times its centre, mass of the second, mass of the second times its centre.
upper = gravity * np.column_stack([np.cos(q1), first * np.cos(q1), np.cos(q1 + q2)])
lower = gravity * np.column_stack([np.zeros(20), np.zeros(20), np.cos(q1 + q2)])
regressor = np.concatenate([upper, lower])
values = np.linalg.svd(regressor, compute_uv=False)
print("singular values", values.round(6))
print(f"3 masses and centres, {np.linalg.matrix_rank(regressor)} combinations: m1 c1 + {first} m2, and m2 c2")
