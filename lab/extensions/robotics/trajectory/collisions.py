"""Whether a robot touches something along its motion: itself, what stands around it, or what comes too near."""

import numpy as np

from lab.core.errors import LabError
from lab.extensions.robotics.trajectory.result import TrajectoryResult
from lab.simulation.collisions import collides, collisions_in_words

__all__ = ["refuse_collisions"]

_STEP_M = 0.01  # by how much no point of the arm moves more between two looks


def refuse_collisions(result: TrajectoryResult) -> None:
    """Look along the whole motion for what the arm touches, unless nothing is to be checked or its shapes are unknown.

    Raises:
        LabError: it touches something; the message says what, when and on which move.
    """
    if not result.checked:
        return
    model, joints = result.robot.model, result.sampled.joints
    travel = np.append(0.0, np.cumsum(np.abs(np.diff(joints, axis=0)) @ model.travel_per_joint()))
    looks = np.unique(np.append(np.linspace(0, travel[-1], 1 + int(np.ceil(travel[-1] / _STEP_M))), travel))
    stands = np.stack([np.interp(looks, travel, column) for column in joints.T], axis=1)
    touched = np.flatnonzero(collides(model, stands))
    if not touched.size:
        return
    seconds = float(np.interp(looks[touched[0]], travel, result.sampled.times))
    leg = result.legs[min(int(np.searchsorted(result.motion.starts, seconds, side="right")) - 1, len(result.legs) - 1)]
    kind = {"joint": "move", "line": "line", "circle": "circle"}[leg.kind]
    words = collisions_in_words(model, stands[touched[:1]])[0] or "something is touched"
    raise LabError(
        f"{result.options.points}: on the {kind} from point {leg.points[0]} to {leg.points[-1]}, at {seconds:.3f} s, "
        f"{words}; move the points, pass by another one, or give --no-check"
    )
