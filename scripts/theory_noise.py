"""How many independent readings a drifting series is worth, and what ignoring that costs."""

import numpy as np

rng, count, rho = np.random.default_rng(0), 200, 0.8
factor = np.sqrt((1 + rho) / (1 - rho))
means = []
for _ in range(4000):
    noise = rng.standard_normal(count)
    series = np.empty(count)
    series[0] = noise[0]
    for i in range(1, count):
        series[i] = rho * series[i - 1] + np.sqrt(1 - rho**2) * noise[i]
    means.append(series.mean())
plain = 1 / np.sqrt(count)
print(f"standard deviation of a mean, seen: {np.std(means):.3f}")
print(f"by the formula {factor * plain:.3f}, for independent readings {plain:.3f}")
