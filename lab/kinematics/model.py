"""The model protocol: the robot as identification, observability and assessment need it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter
from lab.kinematics.serial.chain import Chain

__all__ = ["Model", "RigidArm", "Skeleton"]


class Model(Protocol):
    """Joints and parameters in, observations and their derivatives out.

    A chain (``serial.SerialArm``), several (``tree.TreeArm``), a mechanism with loops (``closed.ClosedArm``), or any of
    these with effects (``effects.arm.ArmWithEffects``). Loops that do not close give NaN. Parameters of the groups
    ``base`` (position and rotation vector in the tracker's frame) and ``tool`` (positions in the last frame) have no
    initial values; all others start at nominal.
    """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters in the order of ``values``."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""

    @property
    def targets(self) -> tuple[str, ...]:
        """Measured points."""

    @property
    def conditions(self) -> tuple[str, ...]:
        """Required columns of ``Measurements.conditions``, after the joints."""

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return observations ``(n, k, d)`` at inputs ``(n, joints + conditions)``; derivatives ``(n, k, d, p)``.

        Points are positions (m, in the tracker's frame), d = 3.
        """

    def points(self, inputs: Array, values: Array) -> Array:
        """Return the observations alone."""

    def column_priority(self) -> tuple[int, ...]:
        """Return parameter indices in the order of preference for identification."""

    def rank_point(self, values: Array) -> Array:
        """Return ``values`` for decisions on rank, with nominal parallelism exact."""

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw inputs ``(count, joints + conditions)`` within the limits for decisions on rank."""


@dataclass(frozen=True)
class Skeleton:
    """An arm as lines at each of ``n`` joint positions, in the frame of its base (m).

    Attributes:
        lines: ``(n, c, 3)`` each: one along a chain, with its corners; one along each leg of a mechanism.
        frames: ``(n, f, 3)`` the frames on the lines, last that of the targets.
        origins: ``(n, f, 3)`` all frames, from the base outward to that of the targets.
        rods: ``(n, rods, 2, 3)`` ends of a mechanism's rods, and of legs whose length is a joint position, the base's
            side first; the four sides of a parallelogram, the long ones first.
        measured: flags of rods whose length is a joint position.
    """

    lines: list[Array]
    frames: Array
    origins: Array
    rods: Array
    measured: tuple[bool, ...]


class RigidArm(Model, Protocol):
    """Geometry of a robot, serial or closed, without effects."""

    @property
    def chain(self) -> JointSpec:
        """Nominal model."""

    def nominal(self, tool: dict[str, Array] | None = None) -> Array:
        """Return nominal parameters: base at the tracker's origin, targets of ``tool`` (m) or the default tool."""

    @property
    def rigid(self) -> "RigidArm":
        """The arm itself."""

    @property
    def groups(self) -> tuple[str, ...]:
        """No groups of effects."""

    def dh_chain(self, values: Array) -> Chain | None:
        """Return the Denavit-Hartenberg chain of parameters ``(p,)``; None for a robot with loops."""

    def skeleton(self, joints: Array, values: Array) -> Skeleton:
        """Return lines at joint positions ``(n, joints)``; parameters ``(p,)`` with the base at the origin."""

    def T_tracker_frame0(self, values: Array) -> Array:
        """Pose ``(4, 4)`` of the base's frame in the tracker's frame."""

    def joint_derivatives(self, jacobian: Array) -> Array:
        """Return the columns of derivatives ``(..., parameters)`` for the readings, ``(..., joints)``."""

    def tool(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
        """Return poses ``(n, 4, 4)`` of a target, and its geometric Jacobian ``(n, 6, joints)``."""

    def singular_distance(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, NDArray[np.int_]]:
        """Return the first-order distance ``(n,)`` (rad, m of a slide) from a singularity, and the joint that moves
        most.
        """
