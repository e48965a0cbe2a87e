"""Section 10.3: the trajectory of a robot of two hinges through a via point, within its joints' limits."""

import numpy as np

from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, formula, number
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.models import sampled, serial
from lab.kinematics.trajectory.phases import Trajectory
from lab.kinematics.trajectory.trajectory import through

__all__ = ["MOTION_ITEMS"]

_FIRST, _SECOND = 0.5, 1.0  # m


def _joints(x: float, y: float, z: float) -> Array:
    return np.array([np.arctan2(y, x), np.arcsin((z - _FIRST) / _SECOND)])


def _moved(middle: tuple[float, float, float], speed: Array) -> tuple[Array, Trajectory]:
    """The joints' via points and the move through them."""
    side = np.sqrt(3) / 2
    points = np.array([_joints(side, 0, 0), _joints(*middle), _joints(side, 0, 1)])
    return points, through(serial("course2r")[0].chain, points, np.array([[0.0, 0], speed, [0.0, 0]]))


def _models() -> tuple[Answer, ...]:
    robot = sampled("course2r")
    p, J = robot.between(0, 2)[:, :3, 3], robot.jacobian()[:, :3]
    v = robot.variables | {"L1": np.full(len(p), _FIRST), "L2": np.full(len(p), _SECOND)}
    v |= {name: p[:, i] for i, name in enumerate("xyz")}
    direct = ("L2 c2 c1", "L2 c2 s1", "L1 + L2 s2")
    rates = (("−L2 c2 s1", "−L2 s2 c1"), ("L2 c2 c1", "−L2 s2 s1"), ("0", "L2 c2"))
    return (
        *(formula("xyz"[i], "", p[:, i], v, right=text) for i, text in enumerate(direct)),
        formula("q1 of x, y, z", "", v["q1"], v, right="atan2(y, x)"),
        formula("q2 of x, y, z", "", v["q2"], v, right="atan2(z − L1, √(x^2 + y^2))"),
        *(formula(f"J({i + 1},{j + 1})", "", J[:, i, j], v, right=text)
          for i, row in enumerate(rates) for j, text in enumerate(row)),
    )  # fmt: skip


def _exact() -> tuple[Answer, ...]:
    speed = np.array([0.0, 0.2])
    points, found = _moved((0.0, 1.0, 0.5), speed)
    degrees, side = np.rad2deg(points), float(np.sqrt(3) / 2)
    accelerations = np.rad2deg(found.accelerations)
    peak = float(np.rad2deg(np.abs(np.cumsum(found.accelerations * found.durations[:, None], axis=0)).max()))
    return (
        number("X of P2", "0.86", side, "m"),
        *(number(f"q{j + 1} at P{i}", "", float(degrees[i, j]), "°", digits=2) for i in range(3) for j in range(2)),
        number("speed of q2 at P1", "", float(np.rad2deg(speed[1])), "°/s", digits=3),
        *(number(f"phase {i + 1}", "", float(seconds), "s", digits=4) for i, seconds in enumerate(found.durations)),
        number("total", "", float(found.seconds), "s", digits=4),
        *(number(f"acceleration of q{j + 1} in phase {i + 1}", "", float(accelerations[i, j]), "°/s²", digits=3)
          for i in range(4) for j in range(2)),
        number("largest speed", "", peak, "°/s", digits=2),
    )  # fmt: skip


def _past() -> tuple[Answer, ...]:
    """P1 passed at the allowed distance dX = 0.1 m, on the arc of q1 that is the shortest."""
    points, found = _moved((0.1, float(np.sqrt(0.99)), 0.5), np.array([0.0, 0.2]))
    return (
        number("q1 where it turns back", "", float(np.rad2deg(points[1, 0])), "°", digits=3),
        number("total past P1", "", float(found.seconds), "s", digits=4),
    )


MOTION_ITEMS = (
    Item("Section 10.3, question 1", "Models of the robot of two hinges", _models,
         "lab kinematics course2r --symbolic"),
    Item("Section 10.3, question 2", "Its trajectory through P1", _exact,
         "lab trajectory POINTS.csv --robot course2r --accelerations 50 --speeds 171.9",
         "POINTS.csv holds the joints of P0, P1 and P2 and the speed of 11.459 °/s at P1, as docs/how_to/trajectories "
         "shows. X2 = 0.86 is √3/2 with its last digits left out. The largest speed, 171.88 °/s, is not reached."),
    Item("Section 10.3, approximation", "The trajectory past P1 with dX = 0.1 m", _past,
         "lab trajectory POINTS.csv --robot course2r --accelerations 50 --speeds 171.9"),
)  # fmt: skip
