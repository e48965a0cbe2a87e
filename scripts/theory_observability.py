"""O1 of a planar two-link arm: by hand, and by the lab; and the poses that make it largest."""

import numpy as np

import lab

first, second = 0.4, 0.3
poses = np.deg2rad([[10, 30], [40, 60], [-30, 100], [80, 45]])
robot = lab.robot_from_dh([[0, 0, first, 0], [0, 0, second, 0]], tool={"p1": [0, 0, 0]})
unknown = ["link1.a", "link2.a", "link1.theta", "link2.theta"]


def by_hand(joints):
    """Return the singular values and O1, in m and rad."""
    # x = l1 cos q1 + l2 cos(q1 + q2), y likewise with sines; unknown are the two lengths and the two offsets.
    a, b = joints[:, 0], joints.sum(axis=1)
    jacobian = np.empty((len(joints), 2, 4))
    jacobian[:, :, 0] = np.column_stack([np.cos(a), np.sin(a)])
    jacobian[:, :, 1] = np.column_stack([np.cos(b), np.sin(b)])
    jacobian[:, :, 3] = second * np.column_stack([-np.sin(b), np.cos(b)])
    jacobian[:, :, 2] = first * np.column_stack([-np.sin(a), np.cos(a)]) + jacobian[:, :, 3]
    values = np.linalg.svd(jacobian.reshape(-1, 4), compute_uv=False)
    return values, np.prod(values) ** (1 / 4) / np.sqrt(len(joints))


def by_lab(joints):
    """Return O1 of the same four parameters; all others are taken as exact."""
    return robot.criteria(joints, parameters=unknown, scaling="si")["o1"]


values, o1 = by_hand(poses)
print("singular values", values.round(4))
print(f"O1 by hand {o1:.6f}, by the lab {by_lab(poses):.6f}")

# Another first joint turns all rows of a pose alike: O1 depends on the second joint alone.
turned = poses + np.deg2rad([[70, 0], [-20, 0], [110, 0], [5, 0]])
print(f"with other first joints {by_lab(turned):.6f}")

# By the second joints alone; the largest possible where their cosines and sines sum to zero.
c, s = np.cos(poses[:, 1]).mean(), np.sin(poses[:, 1]).mean()
print(f"by formula {(first * second * (1 - c**2 - s**2)) ** (1 / 4):.6f}, largest {(first * second) ** (1 / 4):.6f}")
best = np.deg2rad([[0, 0], [0, 90], [0, 180], [0, -90]])
print(f"with q2 = 0, 90, 180, -90 degrees {by_lab(best):.6f}")
