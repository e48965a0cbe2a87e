"""A beam as a chain of springs: the tip converges to Euler's formula as 1 / N^2."""

import numpy as np

length, force, stiffness = 0.5, 30.0, 2e4  # m, N, N m^2
exact = force * length**3 / (3 * stiffness)
for pieces in (1, 2, 4, 8):
    where = (np.arange(pieces) + 0.5) * length / pieces  # a spring in the middle of each piece
    bent = force * (length - where) * (length / pieces) / stiffness  # its moment over its stiffness
    tip = float(bent @ (length - where))
    print(f"{pieces} springs: {1e3 * tip:.5f} mm, {100 * (tip / exact - 1):+.3f} %")
print(f"Euler: {1e3 * exact:.5f} mm")
