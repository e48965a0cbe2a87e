"""Rehearse a camera in the hand beside a tracker: what each identifies of an arm, and what both do together."""

import lab

for observe in ("points", "pixels", "points+pixels"):
    result = lab.calibrate("irb120", observe=observe, poses=25, seed=7)
    values = result.to_dict()
    noise = ", ".join(f"{values[key]:.2g} {key[-2:]}" for key in ("noise_mm", "noise_px") if values.get(key))
    print(f"{observe}: {values['rank']} parameters, error {values['after_mm']['mean']:.4f} mm, noise {noise}")
