"""The chi-square test of a fit: does what is left look like the instrument's noise?"""

import numpy as np
from scipy.stats import chi2

import lab

sigma = 8e-6 / np.sqrt(3)  # of the instrument: uniform within 8 um
for gear_ppm in (0.0, 100.0):
    effects = lab.Effects(gear_ppm=gear_ppm)
    day = lab.simulate("irb120", poses=60, seed=4, effects=effects)
    result = lab.identify(day.measurements, instrument="uniform-8um")
    estimate, data = result.estimate, day.measurements
    residual = estimate.residuals(data.joints, data.points).values
    squares, dof = residual @ residual / sigma**2, len(residual) - 27
    chance = chi2.sf(squares, dof)
    print(
        f"gears {gear_ppm:.0f} ppm: {squares:.0f} for {dof} degrees of freedom, p = {chance:.2g}, {result.verdict.word}"
    )
