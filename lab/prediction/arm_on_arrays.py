"""Give an arm's kinematics, derivatives, identifiability and criteria as methods on plain arrays.

Joint positions are ``(..., joints)`` in rad (m of a slide), with any leading axes, which the results have, too:
``(joints,)`` for one configuration, ``(n, joints)`` for many. An arm with effects of a payload or a temperature takes
their values behind the joint positions, in the order of ``inputs``. Lengths are in m, angles in rad.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.array_arm import ArrayArm, as_numbers
from lab.prediction import planned_accuracy
from lab.prediction.planned_accuracy import CriteriaScaling, Identifiability

__all__ = ["ArmOnArrays", "Residuals", "target_names"]


class Residuals(NamedTuple):
    """Predicted less measured coordinates, and their derivatives.

    Attributes:
        values: ``(r,)`` m, those of one point after the other; points that were not seen are left out.
        jacobian: ``(r, p)`` derivatives by every parameter.
    """

    values: Array
    jacobian: Array


class ArmOnArrays(ABC):
    """Methods of an arm with parameter values, on plain arrays.

    The frame of the points is the instrument's; before any measurement the base stands at its origin. The arm is
    compiled at the first use of some targets, and kept; it is not pickled.
    """

    @abstractmethod
    def _compiled(self, targets: tuple[str, ...] | None) -> ArrayArm:
        """Build the arm with some targets, by default all."""

    @cached_property
    def _kept(self) -> dict[tuple[str, ...] | None, ArrayArm]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields alone: what was built from them holds functions, which no pickle takes."""
        return {each.name: getattr(self, each.name) for each in fields(self)}  # type: ignore[arg-type]

    def on_arrays(self, targets: Sequence[str] | None = None) -> ArrayArm:
        """Return the compiled arm with some targets, by default all.

        Raises:
            LabError: a target is unknown.
        """
        names = None if targets is None else target_names(targets)
        kept = self._kept.get(names)
        return self._kept.setdefault(names, self._compiled(names)) if kept is None else kept

    def _with_target(self, target: str | None) -> ArrayArm:
        """Return the compiled arm with one target, by default the first."""
        return self._with_first if target is None else self.on_arrays((target,))

    @cached_property
    def _with_first(self) -> ArrayArm:
        return self.on_arrays(self.on_arrays().arm.targets[:1])

    def inputs(self) -> tuple[str, ...]:
        """Return what one row of ``joints`` holds: the names of the joints, then those of conditions, if any."""
        return self.on_arrays().inputs

    def parameter_names(self, targets: Sequence[str] | None = None) -> tuple[str, ...]:
        """Return the names ``(p,)`` of all parameters, in the order of every array of parameters.

        Args:
            targets: the measured points; by default all.
        """
        return self.on_arrays(targets).arm.names

    def parameter_values(self, targets: Sequence[str] | None = None) -> Array:
        """Return the values ``(p,)`` of all parameters (m, rad): nominal, or as they were estimated.

        Args:
            targets: the measured points; by default all.
        """
        return self.on_arrays(targets).values.copy()

    def points(
        self, joints: ArrayLike, values: ArrayLike | None = None, *, targets: Sequence[str] | None = None
    ) -> Array:
        """Return the positions of the targets: the forward kinematics.

        Args:
            joints: ``(..., joints)``.
            values: parameters ``(p,)``; by default ``parameter_values``.
            targets: the measured points ``(k,)``; by default all.

        Returns:
            ``(..., k, 3)`` m; NaN where the loops of a mechanism do not close.

        Raises:
            LabError: an array has another shape or is not finite.
        """
        return self.on_arrays(targets).points(joints, values)

    def poses(self, joints: ArrayLike, values: ArrayLike | None = None, *, target: str | None = None) -> Array:
        """Return the poses of a target, with the orientation of the last frame.

        Args:
            joints: ``(..., joints)``.
            values: parameters ``(p,)`` of the arm with that target alone.
            target: by default the first.

        Returns:
            ``(..., 4, 4)``.

        Raises:
            LabError: an array has another shape or is not finite.
        """
        return self._with_target(target).poses(joints, values)

    def jacobian(self, joints: ArrayLike, values: ArrayLike | None = None, *, target: str | None = None) -> Array:
        """Return the geometric Jacobian of a target: its velocity and angular velocity by the joints' rates.

        Args:
            joints: ``(..., joints)``.
            values: parameters ``(p,)`` of the arm with that target alone.
            target: by default the first.

        Returns:
            ``(..., 6, joints)``: m/s and then rad/s, per rad/s (m/s of a slide).

        Raises:
            LabError: an array has another shape or is not finite.
        """
        return self._with_target(target).jacobian(joints, values)

    def parameter_jacobian(
        self, joints: ArrayLike, values: ArrayLike | None = None, *, targets: Sequence[str] | None = None
    ) -> Array:
        """Return the derivatives of ``points`` by every parameter.

        Args:
            joints: ``(..., joints)``.
            values: parameters ``(p,)``; by default ``parameter_values``.
            targets: the measured points ``(k,)``; by default all.

        Returns:
            ``(..., k, 3, p)``, in m per m or rad.

        Raises:
            LabError: an array has another shape or is not finite.
        """
        return self.on_arrays(targets).parameter_jacobian(joints, values)

    def inverse(self, poses: ArrayLike, near: ArrayLike | None = None, *, target: str | None = None) -> Array:
        """Return joint positions at which a target has some poses: the inverse kinematics.

        All solutions are in closed form, which most nominal arms of up to six joints have, and calibrated arms have
        not. Near some joint positions the nearest of these is returned, or the end of Newton's method. Joint limits
        are not checked.

        Args:
            poses: ``(..., 4, 4)`` of the target, as of ``poses``.
            near: ``(joints,)`` or ``(..., joints)`` where one solution is wanted, with the conditions of ``inputs``.
            target: by default the first.

        Returns:
            ``(..., k, joints)`` all solutions, or ``(..., joints)`` the one near ``near``; NaN where there are fewer.

        Raises:
            LabError: an array has another shape or is not finite, or without ``near`` there is no closed form.
        """
        return self._with_target(target).inverse(poses, near)

    def residuals(
        self,
        joints: ArrayLike,
        points: ArrayLike,
        values: ArrayLike | None = None,
        *,
        targets: Sequence[str] | None = None,
    ) -> Residuals:
        """Return predicted less measured coordinates with their derivatives, as a least-squares fit needs them.

        Args:
            joints: ``(..., joints)``.
            points: ``(..., k, 3)`` m, or ``(..., 3)`` of one target; NaN where a target was not seen.
            values: parameters ``(p,)``; by default ``parameter_values``.
            targets: the measured points ``(k,)``; by default all.

        Raises:
            LabError: an array has another shape, or joints or values are not finite.
        """
        compiled = self.on_arrays(targets)
        rows, leading = compiled.rows(joints)
        predicted, jacobian = compiled.arm.observe(rows, compiled.parameters(values))
        measured = as_numbers("points", points)
        if measured.size != predicted.size or measured.shape[-1:] != (3,):
            raise LabError(
                f"points have shape {measured.shape}; give {(*leading, *predicted.shape[1:])}: three coordinates of "
                f"each of {', '.join(compiled.arm.targets)}"
            )
        measured = measured.reshape(predicted.shape)
        seen = np.isfinite(measured).all(axis=-1)
        return Residuals((predicted - measured)[seen].ravel(), jacobian[seen].reshape(-1, jacobian.shape[-1]))

    def identifiability(
        self, joints: ArrayLike | None = None, *, targets: Sequence[str] | None = None
    ) -> Identifiability:
        """Return which parameters measured points identify, and what the errors of the others go into.

        Args:
            joints: ``(..., joints)`` where they are measured; by default random ones, enough for all that can be.
            targets: the measured points; by default all.

        Raises:
            LabError: the joints have another shape or are not finite.
        """
        return planned_accuracy.identifiability(self.on_arrays(targets), joints)

    def criteria(
        self,
        joints: ArrayLike,
        at: ArrayLike | None = None,
        *,
        sigma_m: float | None = None,
        scaling: CriteriaScaling = "raw",
        parameters: Sequence[str] | None = None,
        targets: Sequence[str] | None = None,
    ) -> dict[str, float]:
        """Return the observability indices and variance criteria of a set of poses.

        They are O1 to O5 and the condition number as in Mahdadi & Bouafia (2020), and A, G and I of optimal design
        (Pukelsheim 1993), by their names in small letters: ``o1`` … ``o5``, ``condition``, ``a``, ``g``, ``i``. Larger
        is better but for the condition number, A, G and I.

        Args:
            joints: ``(..., joints)`` where points are to be measured.
            at: ``(..., joints)`` where points are to be predicted, for G and I; without it these are NaN.
            sigma_m: noise of a coordinate, by which all derivatives are divided. The default gives coordinates in mm,
                and in m where the scaling is ``si``.
            scaling: units of the parameters. ``raw``: mm and rad. ``si``: m and rad. ``length``: mm, and angles times
                300 mm. ``whitened``: tolerances of 0.5 mm and 1.5 mrad; give ``sigma_m``, too. ``unit``: each column is
                divided by its norm and multiplied by √n, so that O1 is at most 1, and √n times that of columns of
                norm 1.
            parameters: names or patterns of the unknown parameters, such as ``link1.a`` or ``link*.theta``; all others
                are taken as exact. By default all identifiable ones.
            targets: the measured points; by default all.

        Raises:
            LabError: an array has another shape or is not finite, the noise is not above zero, there is no such scaling
                or parameter, or the poses do not identify every one of the parameters.
        """
        unknown = None if parameters is None else target_names(parameters)
        return planned_accuracy.criteria(self.on_arrays(targets), joints, at, sigma_m, scaling, unknown)

    def planned_covariance(
        self,
        joints: ArrayLike,
        at: ArrayLike,
        *,
        sigma_m: float,
        parameters: Sequence[str] | None = None,
        targets: Sequence[str] | None = None,
    ) -> Array:
        """Return the covariance of points that a calibration at some joint positions would predict at others.

        It is J C J' with the derivatives J at ``at`` and the covariance C of the unknown parameters.

        Args:
            joints: ``(..., joints)`` where points are to be measured, with noise ``sigma_m`` (1σ of a coordinate).
            at: ``(..., joints)`` where they are to be predicted.
            parameters: names or patterns of the unknown parameters, such as ``link1.a`` or ``link*.theta``; all others
                are taken as exact. By default all identifiable ones.
            targets: the measured and predicted points ``(k,)``; by default all.

        Returns:
            ``(..., k, 3, 3)`` m², with the leading axes of ``at``.

        Raises:
            LabError: an array has another shape or is not finite, the noise is not above zero, there is no such
                parameter, or these poses do not identify every one of the parameters.
        """
        unknown = None if parameters is None else target_names(parameters)
        return planned_accuracy.planned_covariance(self.on_arrays(targets), joints, at, sigma_m, unknown)


def target_names(targets: Sequence[str]) -> tuple[str, ...]:
    """Return the names of targets; one may be given by its name alone."""
    return (targets,) if isinstance(targets, str) else tuple(targets)
