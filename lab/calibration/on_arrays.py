"""Give an arm's kinematics, derivatives, identifiability and criteria as methods on plain arrays.

Joint positions are ``(joints,)`` for one configuration or ``(n, joints)`` for many, in rad (m of a slide); the results
have the leading axis of the configurations or not, likewise. An arm with effects of a payload or a temperature takes
their values behind the joint positions, in the order of ``inputs``. Lengths are in m, angles in rad.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from lab.calibration.identifiability import aliases, column_scale, enough_poses, scaled_condition
from lab.core.errors import LabError, counted
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.values import Value
from lab.kinematics.effects.arm_with_effects import Arm
from lab.kinematics.gauge import STRUCTURE_POSES, base_set, named
from lab.pose_selection.criteria import Scaling, indices

__all__ = ["ArmOnArrays", "Identifiability", "Residuals", "refuse_degrees", "target_names"]

_Scaling = Literal["raw", "unit", "length", "whitened", "si"]
_IN_MM, _IN_M = 1e-3, 1.0  # noise that gives coordinates in mm, and in m
_MOST_TURNS = 2  # of a hinge, in most poses: beyond, degrees were given


class Residuals(NamedTuple):
    """Predicted less measured coordinates, and their derivatives.

    Attributes:
        values: ``(r,)`` m, those of one point after the other; points that were not seen are left out.
        jacobian: ``(r, p)`` derivatives by every parameter.
    """

    values: Array
    jacobian: Array


@dataclass(frozen=True, eq=False, repr=False)
class Identifiability(Value):
    """Identifiable parameters of an arm, by the columns of its Jacobian.

    Attributes:
        parameters: names ``(p,)`` of all.
        free: indices ``(f,)`` of a base set of identifiable ones, as a calibration fits them.
        aliases: of each other parameter, the free ones that its error goes into, and how much of it (SI units).
        singular_values: ``(f,)`` of the free columns, scaled to unit norm.
        condition: the ratio of the largest to the smallest; infinite where the poses do not identify all.
    """

    parameters: tuple[str, ...]
    free: tuple[int, ...]
    aliases: Mapping[str, Mapping[str, float]]
    singular_values: Array
    condition: float

    @property
    def identifiable(self) -> tuple[str, ...]:
        """Names ``(f,)`` of the free parameters."""
        return tuple(self.parameters[i] for i in self.free)

    @property
    def rank(self) -> int:
        """The number of identifiable parameters."""
        return len(self.free)

    def _about(self) -> str:
        return f"{self.rank} of {len(self.parameters)} parameters, condition number {self.condition:.3g}"


class ArmOnArrays(ABC):
    """Methods of an arm with parameter values, on plain arrays.

    The frame of the points is the instrument's; before any measurement the base stands at its origin.
    """

    @abstractmethod
    def _modelled(self, targets: Sequence[str] | None) -> tuple[Arm, Array, Array]:
        """Return the model with some targets, its parameter values ``(p,)``, and those of the nominal model."""

    def inputs(self) -> tuple[str, ...]:
        """Return what one row of ``joints`` holds: the names of the joints, then those of conditions, if any."""
        arm = self._modelled(None)[0]
        return (*arm.rigid.chain.joint_names, *arm.conditions)

    def parameter_names(self, targets: Sequence[str] | None = None) -> tuple[str, ...]:
        """Return the names ``(p,)`` of all parameters, in the order of every array of parameters.

        Args:
            targets: the measured points; by default all.
        """
        return self._modelled(targets)[0].names

    def parameter_values(self, targets: Sequence[str] | None = None) -> Array:
        """Return the values ``(p,)`` of all parameters (m, rad): nominal, or as they were estimated.

        Args:
            targets: the measured points; by default all.
        """
        return self._modelled(targets)[1].copy()

    def points(
        self, joints: ArrayLike, values: ArrayLike | None = None, *, targets: Sequence[str] | None = None
    ) -> Array:
        """Return the positions of the targets: the forward kinematics.

        Args:
            joints: ``(joints,)`` or ``(n, joints)``.
            values: parameters ``(p,)``; by default ``parameter_values``.
            targets: the measured points ``(k,)``; by default all.

        Returns:
            ``(k, 3)`` or ``(n, k, 3)`` m; NaN where the loops of a mechanism do not close.

        Raises:
            LabError: an array has another shape or is not finite.
        """
        arm, own, one = self._given(joints, values, targets)
        return _like(joints, arm.points(one, own))

    def poses(self, joints: ArrayLike, values: ArrayLike | None = None, *, target: str | None = None) -> Array:
        """Return the poses of a target, with the orientation of the last frame.

        Args:
            joints: ``(joints,)`` or ``(n, joints)``.
            values: parameters ``(p,)`` of the arm with that target alone.
            target: by default the first.

        Returns:
            ``(4, 4)`` or ``(n, 4, 4)``.

        Raises:
            LabError: an array has another shape or is not finite.
        """
        arm, own, rows = self._given(joints, values, self._first(target))
        return _like(joints, arm.tool(rows, own)[0])

    def jacobian(self, joints: ArrayLike, values: ArrayLike | None = None, *, target: str | None = None) -> Array:
        """Return the geometric Jacobian of a target: its velocity and angular velocity by the joints' rates.

        Args:
            joints: ``(joints,)`` or ``(n, joints)``.
            values: parameters ``(p,)`` of the arm with that target alone.
            target: by default the first.

        Returns:
            ``(6, joints)`` or ``(n, 6, joints)``: m/s and then rad/s, per rad/s (m/s of a slide).

        Raises:
            LabError: an array has another shape or is not finite.
        """
        arm, own, rows = self._given(joints, values, self._first(target))
        return _like(joints, arm.tool(rows, own)[1])

    def parameter_jacobian(
        self, joints: ArrayLike, values: ArrayLike | None = None, *, targets: Sequence[str] | None = None
    ) -> Array:
        """Return the derivatives of ``points`` by every parameter.

        Args:
            joints: ``(joints,)`` or ``(n, joints)``.
            values: parameters ``(p,)``; by default ``parameter_values``.
            targets: the measured points ``(k,)``; by default all.

        Returns:
            ``(k, 3, p)`` or ``(n, k, 3, p)``, in m per m or rad.

        Raises:
            LabError: an array has another shape or is not finite.
        """
        arm, own, rows = self._given(joints, values, targets)
        return _like(joints, arm.observe(rows, own)[1])

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
            joints: ``(joints,)`` or ``(n, joints)``.
            points: ``(k, 3)`` or ``(n, k, 3)`` m, or ``(n, 3)`` of one target; NaN where a target was not seen.
            values: parameters ``(p,)``; by default ``parameter_values``.
            targets: the measured points ``(k,)``; by default all.

        Raises:
            LabError: an array has another shape, or joints or values are not finite.
        """
        arm, own, rows = self._given(joints, values, targets)
        predicted, jacobian = arm.observe(rows, own)
        measured = _numbers("points", points)
        if measured.size != predicted.size or measured.shape[-1:] != (3,):
            raise LabError(
                f"points have shape {measured.shape}; give {_like(joints, predicted).shape}: three coordinates of each "
                f"of {', '.join(arm.targets)}"
            )
        measured = measured.reshape(predicted.shape)
        seen = np.isfinite(measured).all(axis=-1)
        return Residuals((predicted - measured)[seen].ravel(), jacobian[seen].reshape(-1, len(own)))

    def identifiability(
        self, joints: ArrayLike | None = None, *, targets: Sequence[str] | None = None
    ) -> Identifiability:
        """Return which parameters measured points identify, and what the errors of the others go into.

        Args:
            joints: ``(n, joints)`` where they are measured; by default random ones, enough for all that can be.
            targets: the measured points; by default all.

        Raises:
            LabError: the joints have another shape or are not finite.
        """
        arm, _, nominal = self._modelled(targets)
        rows = None if joints is None else _some(_rows(arm, joints))
        structure = base_set(arm, nominal, rows)
        if rows is None:
            rows = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
        columns = arm.observe(rows, arm.rank_point(nominal))[1].reshape(-1, len(arm.names))[
            :, list(structure.identifiable)
        ]
        unit = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        into = aliases(arm, structure, column_scale(arm, nominal))
        return Identifiability(
            arm.names,
            structure.identifiable,
            {each.name: dict(each.into) for each in into},
            np.linalg.svd(unit, compute_uv=False),
            scaled_condition(columns),
        )

    def criteria(
        self,
        joints: ArrayLike,
        at: ArrayLike | None = None,
        *,
        sigma_m: float | None = None,
        scaling: _Scaling = "raw",
        parameters: Sequence[str] | None = None,
        targets: Sequence[str] | None = None,
    ) -> dict[str, float]:
        """Return the observability indices and variance criteria of a set of poses.

        They are O1 to O5 and the condition number as in Mahdadi & Bouafia (2020), and A, G and I of optimal design
        (Pukelsheim 1993), by their names in small letters: ``o1`` … ``o5``, ``condition``, ``a``, ``g``, ``i``. Larger
        is better but for the condition number, A, G and I.

        Args:
            joints: ``(n, joints)`` where points are to be measured.
            at: ``(t, joints)`` where points are to be predicted, for G and I; without it these are NaN.
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
        if scaling not in get_args(_Scaling):
            raise LabError(f"scaling is {scaling!r}; give {', '.join(get_args(_Scaling)[:-1])} or si")
        sigma = (_IN_M if scaling == "si" else _IN_MM) if sigma_m is None else sigma_m
        free = self._unknown(parameters, targets)
        arm, _, nominal = self._modelled(targets)
        measured = self._whitened(joints, nominal, targets, free, sigma)
        self._refuse_too_few(measured, free, targets)
        predicted = None if at is None else self._whitened(at, nominal, targets, free, sigma, "at")
        factors = np.ones(len(free))
        if scaling != "si":
            unit = 1e3 if scaling in ("raw", "length") else 1.0  # lengths in mm, of which a coordinate moves 1e-3 m
            factors = Scaling(scaling).columns([arm.parameters[i] for i in free], measured) / unit
        found = indices(measured * factors, None if predicted is None else predicted * factors)
        return {name: float(value) for name, value in asdict(found).items()}

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
            joints: ``(n, joints)`` where points are to be measured, with noise ``sigma_m`` (1σ of a coordinate).
            at: ``(joints,)`` or ``(m, joints)`` where they are to be predicted.
            parameters: names or patterns of the unknown parameters, such as ``link1.a`` or ``link*.theta``; all others
                are taken as exact. By default all identifiable ones.
            targets: the measured and predicted points ``(k,)``; by default all.

        Returns:
            ``(k, 3, 3)`` or ``(m, k, 3, 3)`` m².

        Raises:
            LabError: an array has another shape or is not finite, the noise is not above zero, there is no such
                parameter, or these poses do not identify every one of the parameters.
        """
        free = self._unknown(parameters, targets)
        nominal = self._modelled(targets)[2]
        measured = self._whitened(joints, nominal, targets, free, sigma_m)
        self._refuse_too_few(measured, free, targets)
        upper = np.asarray(np.linalg.qr(measured.reshape(-1, len(free)), mode="r"))
        arm, own, rows = self._given(at, nominal, targets)
        self._refuse_degrees(arm, rows, "at")
        ahead = arm.observe(rows, own)[1][..., free]
        spread = np.linalg.solve(upper.T, ahead.reshape(-1, len(free)).T).T.reshape(ahead.shape)
        return _like(at, spread @ np.swapaxes(spread, -1, -2))

    def _unknown(self, parameters: Sequence[str] | None, targets: Sequence[str] | None) -> list[int]:
        """Return the indices of the parameters that are named, or of all identifiable ones."""
        if parameters is None:
            return list(self.identifiability(targets=targets).free)
        patterns = target_names(parameters)
        if not patterns:
            raise LabError("parameters: none is named; name one or more, or leave parameters out for all identifiable")
        return list(named(self._modelled(targets)[0].names, "parameters", patterns))

    def _refuse_too_few(self, measured: Array, free: list[int], targets: Sequence[str] | None) -> None:
        """Refuse poses that do not identify every parameter, with the number that does.

        Args:
            measured: derivatives ``(n, r, f)`` at the poses.
        """
        if np.isfinite(scaled_condition(measured.reshape(-1, len(free)))):
            return
        arm, _, nominal = self._modelled(targets)
        rows = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
        many = arm.observe(rows, arm.rank_point(nominal))[1][..., free].reshape(len(rows), -1, len(free))
        if not np.isfinite(scaled_condition(many.reshape(-1, len(free)))):
            names = [arm.names[i] for i in free]
            raise LabError(
                f"parameters: no poses identify all of {', '.join(names)}: some of them have the same effect, or none; "
                "identifiability().aliases lists them"
            )
        least = enough_poses(many)
        what = counted(len(free), "parameter")
        if len(measured) < least:
            raise LabError(
                f"joints: {counted(len(measured), 'pose')} do not identify {what}, which need {least} poses or more"
            )
        raise LabError(
            f"joints: these {counted(len(measured), 'pose')} do not identify {what}: they are too alike; vary every "
            "joint"
        )

    def _whitened(
        self,
        joints: ArrayLike,
        nominal: Array,
        targets: Sequence[str] | None,
        free: list[int],
        sigma_m: float,
        where: str = "joints",
    ) -> Array:
        """Return derivatives ``(n, 3 k, f)`` by the free parameters, in units of the noise."""
        if not 0 < sigma_m < np.inf:
            raise LabError(f"sigma_m is {sigma_m:g}; give the noise of a coordinate in m, above zero")
        arm, own, rows = self._given(joints, nominal, targets)
        self._refuse_degrees(arm, rows, where)
        jacobian = arm.observe(_some(rows), arm.rank_point(own))[1][..., free] / sigma_m
        return np.asarray(jacobian.reshape(len(rows), -1, len(free)))

    @staticmethod
    def _refuse_degrees(arm: Arm, rows: Array, where: str) -> None:
        hinges = ~np.asarray(arm.rigid.chain.prismatic, dtype=bool)
        refuse_degrees(rows[:, : len(hinges)][:, hinges], where, "give joints in rad, such as np.deg2rad(joints),")

    def _first(self, target: str | None) -> tuple[str, ...]:
        return (self._modelled(None)[0].targets[0] if target is None else target,)

    def _given(
        self, joints: ArrayLike, values: ArrayLike | None, targets: Sequence[str] | None
    ) -> tuple[Arm, Array, Array]:
        """Return the model, its parameters ``(p,)`` and the joint positions ``(n, joints)``, checked."""
        arm, own, _ = self._modelled(targets)
        if values is not None:
            own = _numbers("values", values)
            if own.shape != (len(arm.names),) or not np.isfinite(own).all():
                raise LabError(
                    f"values have shape {own.shape}; give {len(arm.names)} finite numbers in the order of "
                    "parameter_names()"
                )
        return arm, own, _rows(arm, joints)


def refuse_degrees(hinges: Array, where: str, remedy: str) -> None:
    """Refuse positions ``(n, hinges)`` in rad that no hinge takes: degrees that were called radians."""
    most = float(np.median(np.abs(hinges).max(axis=1))) if hinges.size else 0.0
    if most > 2 * np.pi * _MOST_TURNS:
        raise LabError(
            f"{where}: in half of the poses a joint is at {most:.0f} rad or more; {remedy} if joints are in degrees"
        )


def target_names(targets: Sequence[str]) -> tuple[str, ...]:
    """Return the names of targets; one may be given by its name alone."""
    return (targets,) if isinstance(targets, str) else tuple(targets)


def _numbers(argument: str, values: ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise LabError(f"{argument}: not numbers in rows of one length ({error})") from None


def _rows(arm: Arm, joints: ArrayLike) -> Array:
    rows, names = _numbers("joints", joints), (*arm.rigid.chain.joint_names, *arm.conditions)
    if rows.ndim not in (1, 2) or rows.shape[-1] != len(names) or not np.isfinite(rows).all():
        raise LabError(
            f"joints have shape {rows.shape}; give ({len(names)},) or (n, {len(names)}) finite numbers: "
            f"{', '.join(names)}"
        )
    return np.atleast_2d(rows)


def _some(rows: Array) -> Array:
    if not len(rows):
        raise LabError("joints hold no configuration; give at least one")
    return rows


def _like(joints: ArrayLike, found: Array) -> Array:
    """Return results of many configurations; of one without their axis."""
    return np.asarray(found[0] if np.ndim(joints) == 1 else found)
