"""A first calibration: a virtual IRB 120 misses by millimetres, is measured, identified, and hits to microns."""

import lab

# A measurement session: a robot whose bodies are a little off, and an instrument that measures it in 50 poses.
day = lab.simulate("irb120", poses=50, seed=7, instrument="uniform-8um")

# The identifier knows the nominal model and the measurements. It is validated on 1,000 other poses, without noise.
result = lab.identify(day.measurements, robot="irb120", instrument="uniform-8um", validate=day.validation)

print(result.summary())
result.report("first_calibration.html")  # the page to read and print
