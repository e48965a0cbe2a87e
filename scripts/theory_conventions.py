"""Two axes that are parallel in the drawing: the D-H length jumps, Hayati's angle does not."""

import numpy as np

import lab

# A second axis 270 mm away, 0.1 mm off in the plane, and tilted by a small angle.
for tilt in (1e-3, 1e-5, 1e-7):
    print(f"tilt {1e6 * tilt:8.1f} urad: d of the common normal is {0.1 / np.tan(tilt):.4g} mm")

# The lab gives such a joint beta in place of d, and one radian of beta stays one radian.
robot = lab.load_robot("irb120")
names = robot.parameter_names()
joints = np.deg2rad([[10, 20, 30, 40, 50, 60]])
moved = robot.parameter_jacobian(joints)[0, 0, :, names.index("link2.beta")]
print(f"1 mrad of link2.beta moves the target by {np.linalg.norm(moved):.3f} mm")
