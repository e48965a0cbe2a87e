"""What a virtual arm's parameters truly are, as a kind of observation would identify them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lab.calibration.identify import Identification
from lab.calibration.observations.fixtures import Fixtures
from lab.calibration.observations.full_pose import Poses
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.axes_to_dh import JointAxes, Truth, parameters_from_axes
from lab.simulation.effects import Effects
from lab.simulation.observations.full_pose import target_rotations
from lab.simulation.true_robot import TrueRobot

__all__ = ["truth_as_observed"]


def truth_as_observed(
    truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
) -> Truth | None:
    """The true parameters in the gauge of the observation that an identification is of.

    Poses add the rotation of the measured frame in the arm's last one. At fixtures the base is the origin; without a
    known length the arm is scaled so that its longest link has its nominal length, as no contact tells its size.

    Args:
        truth: of the arm, measured by points.
        found: from the same targets.
        real: the arm.
        placed: where fixtures truly are (``SimulatedDay.placed``).

    Returns:
        None where a mechanism is measured at fixtures: its gauge is another.
    """
    model = found.model
    if isinstance(model, Poses):
        return _of_poses(truth, model, real)
    if not isinstance(model, Fixtures):
        return truth
    return _at_fixtures(truth, model, found, placed) if isinstance(truth.arm, SerialArm) else None


def _of_poses(truth: Truth, model: Poses, real: TrueRobot) -> Truth | None:
    if not isinstance(truth.arm, SerialArm):
        return None
    rest = np.zeros((1, real.robot.chain.size))
    measured = target_rotations(real.with_effects(Effects.none(real.robot.chain.size)), rest, model.oriented)[0]
    last = truth.arm.flange(rest, truth.values)[0, :3, :3]
    rotation = dict(zip(("tool.rx", "tool.ry", "tool.rz"), se3.log(last.T @ measured).tolist(), strict=True))
    return replace(truth, effects={**truth.effects, **rotation})


def _at_fixtures(truth: Truth, model: Fixtures, found: Identification, placed: Mapping[str, Array]) -> Truth:
    scale, at = 1.0, model.scale_link
    if model.contact and at not in found.base_set.kept:
        scale = float(model.nominal_arm[at] / truth.of([model.names[at]])[0])
        truth = replace(_scaled(truth, scale), effects=truth.effects)
    arm, values = truth.arm, truth.values.copy()
    assert isinstance(arm, SerialArm)
    T_base_instrument = se3.inverse(arm.T_tracker_frame0(values))
    values[:6] = 0.0
    owners = [f"{model.group}.{label}" for label in model.labels]
    there = model.at_base(np.stack([placed[owner] for owner in owners]), T_base_instrument, scale)
    known = dict(zip(model.names[model.first :], there.ravel().tolist(), strict=True))
    for each in model.offset:
        known[each.name] = float(placed[each.owner][0])
    return replace(truth, values=values, effects={**truth.effects, **known})


def _scaled(truth: Truth, scale: float) -> Truth:
    """The truth of an arm whose lengths are so many times as long, in the same gauge: all joints turn."""
    arm = truth.arm
    assert isinstance(arm, SerialArm)
    axes = [motion for motion in arm.motions(truth.values) if motion.joint is not None]
    origins = np.array([motion.origin[:3, 0] for motion in axes if motion.origin is not None])
    directions = np.array([motion.axis[:3, 0] for motion in axes]) * arm.chain.sign[:, None]
    targets = arm.points(np.zeros((1, arm.chain.size)), truth.values)[0]
    return parameters_from_axes(arm, JointAxes(scale * origins, directions, scale * targets), truth.values)
