"""A measurement session with 60 poses designed for geometry and some effects, which an identifier then searches."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lab.calibration.identification import Identification, identify
from lab.calibration.statistics.model_selection import Selection, select
from lab.calibration.weights import Noise
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.effects.effect import HOUR_S
from lab.kinematics.gauge import base_set
from lab.kinematics.model import Model
from lab.kinematics.serial.serial_arm import SerialArm
from lab.library.hand_load import HandLoad
from lab.noise.instruments import Instrument, instrument
from lab.pose_selection.criteria import criterion
from lab.pose_selection.exchange import exchange
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.candidate_poses import draw_candidates
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track
from lab.simulation.true_robot import TrueRobot

POSES, CANDIDATES, FRESH = 60, 1000, 1000
PAYLOADS_KG = (0.0, 3.0)


@dataclass(frozen=True)
class DesignedCampaign:
    """Which robot is measured, at which targets, and the groups of effects that the poses are designed for.

    Attributes:
        payloads_kg: what it carries, one of them at each pose.
        load: where that hangs, as it was weighed; None at the last frame's origin.
    """

    robot_name: str
    targets: tuple[str, ...]
    groups: tuple[str, ...]
    device_name: str = "uniform-8um"
    payloads_kg: tuple[float, ...] = PAYLOADS_KG
    load: HandLoad | None = None

    @cached_property
    def robot(self) -> Robot:
        """The nominal robot."""
        robot = load_virtual(self.robot_name)
        return robot if self.load is None else self.load.carried_by(robot)

    @property
    def device(self) -> Instrument:
        """The instrument."""
        return instrument(self.device_name)

    @cached_property
    def designed(self) -> tuple[Array, Array]:
        """Joint positions ``(60, joints)`` and payloads ``(60,)`` kg, D-optimal for geometry and the groups."""
        model, arm = self.robot.serial_model, self.robot.arm_with(self.targets, self.groups)
        drawn = draw_candidates(model, self.targets, self.device, CANDIDATES, rng_for(0, "candidates")).joints
        inputs = np.concatenate([np.insert(drawn, drawn.shape[1], mass, axis=1) for mass in self.payloads_kg])
        rigid = model.values_before(self.robot.arm(self.targets), model.T_world_tracker)
        values = np.concatenate([rigid, np.zeros(len(arm.names) - len(rigid))])
        kept = list(base_set(arm, values).identifiable)
        jacobian = arm.observe(inputs, values)[1][..., kept].reshape(len(inputs), -1, len(kept))
        pool = jacobian / np.linalg.norm(jacobian, axis=(0, 1))
        design = exchange(inputs, pool, POSES, criterion("O1", len(kept)), rng_for(0, "design"), starts=1)
        return design.joints[:, :-1], design.joints[:, -1]

    def measured(self, real: TrueRobot, seed: int) -> Measurements:
        """The designed poses, with every condition that a group could ask for."""
        joints, payload = self.designed
        rng = rng_for(seed, "conditions")
        names = real.robot.chain.joint_names
        sides = rng.choice([-1.0, 1.0], joints.shape)
        conditions = {f"approach_{name}": sides[:, i] for i, name in enumerate(names)}
        conditions |= {"payload_kg": payload, "time_s": np.linspace(0.0, HOUR_S, len(joints))}
        return track(real, joints, self.targets, self.device, rng_for(seed, "noise"), conditions=conditions)

    def selected(self, data: Measurements) -> Selection:
        """As ``--model auto`` does."""
        robot = self.robot
        return select(lambda groups: robot.arm_with(self.targets, groups), data, self._nominal, Noise(self.device))

    def identified(self, data: Measurements, groups: tuple[str, ...]) -> Identification:
        """With these groups, asked for by name."""
        arm = self.robot.arm_with(self.targets, groups)
        return identify(arm, data, self._nominal(arm), Noise(self.device))

    def fresh_errors(self, real: TrueRobot, found: Identification, seed: int, poses: int = FRESH) -> Array:
        """Lengths ``(poses, targets)`` m of the identified arm's errors at other poses and payloads."""
        joints = random_poses(real.robot, poses, rng_for(seed, "fresh"))
        payload = rng_for(seed, "conditions").spawn(1)[0].choice(self.payloads_kg, poses)
        exact = real.points(joints, self.targets, {"payload_kg": payload})
        known = {"payload_kg": payload} | {f"approach_{n}": np.zeros(poses) for n in real.robot.chain.joint_names}
        columns = (known.get(name, np.zeros(poses))[:, None] for name in found.model.conditions)
        inputs = np.concatenate([joints, *columns], axis=1)
        errors: Array = np.linalg.norm(found.model.points(inputs, found.values) - exact, axis=2)
        return errors

    def _nominal(self, model: Model) -> Array:
        assert isinstance(model, SerialArm | ArmWithEffects)
        return model.nominal(self.robot.tool)
