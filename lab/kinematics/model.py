"""The seam: all that identification, observability and assessment ever need of an arm."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter
from lab.kinematics.serial.chain import Chain
from lab.kinematics.skeleton import Skeleton

__all__ = ["Model", "RigidArm"]


class Model(Protocol):
    """Joints and parameters in, positions and their derivatives out.

    A chain is one (``serial.SerialArm``), a mechanism with loops another (``closed.ClosedArm``), either with joint
    effects a third (``effects.arm.ArmWithEffects``), and nothing above asks which. Where the joint positions cannot be
    met (loops that do not close) its answers are NaN. Parameters of the groups ``base`` (position and rotation vector
    in the tracker's frame) and ``tool`` (a target's position in the last frame) are located with no initial guess; all
    others start at their nominal values.
    """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Specifications of the parameters, in the order of every ``values``."""

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""

    @property
    def targets(self) -> tuple[str, ...]:
        """The measured points."""

    @property
    def conditions(self) -> tuple[str, ...]:
        """Conditions that the model requires: columns of ``Measurements.conditions``, after the joints."""

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Observations ``(n, k, d)`` at settings ``(n, joints + conditions)``; derivatives ``(n, k, d, p)``.

        Of points they are positions (m, in the tracker's frame), d = 3.
        """

    def points(self, inputs: Array, values: Array) -> Array:
        """The observations alone."""

    def column_priority(self) -> tuple[int, ...]:
        """Parameter indices in the order in which they are retained if they are identifiable."""

    def rank_point(self, values: Array) -> Array:
        """``values`` where the rank is decided: exactly as the drawing means them."""

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Settings ``(count, joints + conditions)`` spread over the limits, at which the rank is decided."""


class RigidArm(Model, Protocol):
    """A robot's geometry alone, serial or closed, before joint effects."""

    @property
    def chain(self) -> JointSpec:
        """The drawing, whose joints are measured."""

    def nominal(self, tool: dict[str, Array] | None = None) -> Array:
        """The drawing's parameters: base at the tracker's origin, targets of ``tool`` (m), else of the default tool."""

    @property
    def rigid(self) -> "RigidArm":
        """Its geometry alone: the arm itself."""

    @property
    def groups(self) -> tuple[str, ...]:
        """The names of its groups of effects: none."""

    def dh_chain(self, values: Array) -> Chain | None:
        """The Denavit-Hartenberg chain with the links of parameters ``(p,)``; None of a robot with loops."""

    def skeleton(self, joints: Array, values: Array) -> Skeleton:
        """The arm as lines at joint positions ``(n, joints)``; parameters ``(p,)`` with the base at the origin."""

    def T_tracker_frame0(self, values: Array) -> Array:
        """Pose ``(4, 4)`` of the base's frame in the tracker's: what the base's parameters say."""

    def joint_derivatives(self, jacobian: Array) -> Array:
        """Return the columns of derivatives ``(..., parameters)`` for the readings, ``(..., joints)``."""

    def tool(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
        """Poses ``(n, 4, 4)`` of a target, and its geometric Jacobian by the readings ``(n, 6, joints)``."""

    def singular_distance(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, NDArray[np.int_]]:
        """Return the first-order distance (rad, m of a slide) of readings ``(n, joints)`` from a singularity.

        Returns:
            ``(n,)`` the distances, and the joint (from 0) that would have to move most.
        """
