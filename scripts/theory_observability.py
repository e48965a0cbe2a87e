"""O1 of a planar two-link arm: by hand, and by the lab."""

import numpy as np

import lab

first, second = 0.4, 0.3
joints = np.deg2rad([[0, 90], [120, 90], [240, 90], [60, -90]])

# By hand: x = l1 cos q1 + l2 cos(q1 + q2), y likewise with sines; unknown are the two lengths and the two offsets.
a, b = joints[:, 0], joints.sum(axis=1)
by_hand = np.empty((4, 2, 4))
by_hand[:, :, 0] = np.column_stack([np.cos(a), np.sin(a)])
by_hand[:, :, 1] = np.column_stack([np.cos(b), np.sin(b)])
by_hand[:, :, 3] = second * np.column_stack([-np.sin(b), np.cos(b)])
by_hand[:, :, 2] = first * np.column_stack([-np.sin(a), np.cos(a)]) + by_hand[:, :, 3]
values = np.linalg.svd(by_hand.reshape(-1, 4), compute_uv=False)
print("singular values", values.round(4))
print(f"O1 by hand {np.prod(values) ** (1 / 4) / np.sqrt(4):.6f}")

# By the lab: the same four columns of its parameter Jacobian.
robot = lab.robot_from_dh([[0, 0, first, 0], [0, 0, second, 0]], tool={"p1": [0, 0, 0]})
names = robot.parameter_names()
chosen = [names.index(name) for name in ("link1.a", "link2.a", "link1.theta", "link2.theta")]
jacobian = robot.parameter_jacobian(joints)[:, 0, :2][..., chosen].reshape(-1, 4)
print(f"O1 by the lab {np.sqrt(np.linalg.det(jacobian.T @ jacobian)) ** (1 / 4) / np.sqrt(4):.6f}")
