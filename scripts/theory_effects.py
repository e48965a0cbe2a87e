"""An arm whose joints are springs: geometry alone cannot fit it, one compliance a joint can."""

import lab

soft = lab.Effects(stiffness_nm_per_rad=40000.0)
day = lab.simulate("irb120", poses=80, seed=3, effects=soft)
for model in ("geometric", "compliance"):
    result = lab.identify(day.measurements, instrument="uniform-8um", model=model, validate=day.validation)
    print(f"{model:10} {1e3 * result.validation.errors.after.mean():.4f} mm, {result.verdict.word}")
