"""What each way to touch something identifies of an arm: ranks, and whether the arm's size is among it."""

import numpy as np

from lab.campaign.robot import load_virtual
from lab.kinematics.gauge import base_set
from lab.sensors.artefact import Artefact
from lab.sensors.ball_bar import BallBar
from lab.sensors.cable import Cable
from lab.sensors.cube import Cube
from lab.sensors.dial import Dials
from lab.sensors.fixtures import Fixtures
from lab.sensors.plane import Planes
from lab.sensors.socket import Sockets
from lab.sensors.sphere_plate import SpherePlate, TouchedSpheres

ROBOT = load_virtual("irb120")
ARM = ROBOT.arm(("p1",))
NOMINAL = ARM.nominal(ROBOT.tool)
FACES = tuple((*(sense * np.eye(3)[i]), 0.1, 0.0) for i in range(3) for sense in (1.0, -1.0))  # of a cube of 200 mm
SPHERES = ((-0.1, -0.1, 0.0, 0.02), (0.1, -0.1, 0.0, 0.02), (0.1, 0.1, 0.0, 0.02), (-0.1, 0.1, 0.0, 0.02))


def at(kind: type[Fixtures], places: int, **more: object) -> Fixtures:
    """Return the arm at so many fixtures."""
    labels = tuple(f"{place // 2}.{place % 2}" for place in range(places))
    return kind(ARM, NOMINAL, tuple(range(places)), labels, **more)


def touched(kind: type[Artefact], features: tuple[tuple[float, ...], ...]) -> Fixtures:
    """Return the arm at two places of an artefact, each touched on all of these features."""
    pairs = tuple((place, feature) for place in range(2) for feature in range(len(features)))
    return at(kind, 2, features=features, touched=pairs)


CASES = {
    "cable, 2 anchors": at(Cable, 2),
    "socket, 2": at(Sockets, 2),
    "socket, 2, distance known": at(Sockets, 2, distance_m=0.1),
    "plane, 3": at(Planes, 3),
    "cube, all faces, 2 places": touched(Cube, FACES),
    "cube, 3 faces, 2 places": touched(Cube, FACES[::2]),
    "sphere plate, centred, 2 places": touched(SpherePlate, SPHERES),
    "sphere plate, touched, 2 places": touched(TouchedSpheres, SPHERES),
    "ball bar, 2 sockets": touched(BallBar, ((0.2,),)),
    "dial, 3 directions": at(Dials, 3),
}
print(f"{'':32} {'rank':>4} {'of them links and tool':>23}  size of the arm")
for name, model in CASES.items():
    values = np.asarray(model.nominal(NOMINAL))
    if isinstance(model, Dials | Cable):  # that are not touched: they stand anywhere
        values[model.first :] = np.random.default_rng(0).normal(0, 0.5, len(values) - model.first)
    prior = model.extra_residuals(model.rank_point(values))[1]
    found = base_set(model, values, prior_rows=prior).identifiable
    size = "identified" if model.scale_link in found else "not identified"
    print(f"{name:32} {len(found):4d} {sum(i < len(ARM.names) for i in found):23d}  {size}")
