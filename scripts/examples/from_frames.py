"""From tables of pandas and polars to a calibration, and its results as tables."""

import numpy as np
import pandas
import polars

import lab

# A table with a row for each pose, as a program of yours may have it; here a virtual robot makes it.
day = lab.simulate("irb120", poses=60, seed=7)
table = day.measurements.to_frame()
joint_columns, point_columns = ["q1", "q2", "q3", "q4", "q5", "q6"], ["p1.x", "p1.y", "p1.z"]
print(type(table).__module__.partition(".")[0], table.shape)

# pandas: columns go in as they are; what else the table has is given by name.
measured = lab.measurements(table[joint_columns], table[point_columns], robot="irb120", ids=table["id"])
result = lab.identify(measured, instrument="uniform-8um")
print(f"from pandas: {result.verdict.word}")
print(result.to_frame().query("name == 'link2.a'")[["estimate", "std"]].round(6).to_string(index=False))

# polars: measurements go out and come in without a copy by hand, by the Arrow interface.
frame = polars.DataFrame(day.measurements)
again = lab.measurements(frame[joint_columns], frame[point_columns], robot="irb120", ids=frame["id"])
print(f"from polars: {frame.shape}, the same measurements: {again == measured}")

# Predicted points and their standard deviations beside the measured ones.
spread = np.sqrt(np.trace(result.estimate.predicted_covariance(measured.joints)[:, 0], axis1=1, axis2=2))
off = np.linalg.norm(result.estimate.points(measured.joints)[:, 0] - measured.points[:, 0], axis=1)
errors = pandas.DataFrame({"off_um": 1e6 * off, "predicted_um": 1e6 * spread})
print(errors.mean().round(1).to_string())
