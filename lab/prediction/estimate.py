"""Represent an arm as a calibration estimates it: parameters with their covariance, and predictions from them.

An estimate holds in other sessions: its arm leaves out the measurement session's effects. Errors of predicted points
are those of the identified parameters, J C J' with the derivatives J and the covariance C, those of a load, the model
discrepancy within the measured range and beyond it, and what differs from one visit of a pose to the next.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lab.calibration.residual.gaussian_process import JointProcess, PredictedBy
from lab.core import se3
from lab.core.checks import Check
from lab.core.errors import LabError, counted
from lab.core.se3 import Array
from lab.core.units import MM
from lab.core.values import DeferredField, Value
from lab.kinematics.array_arm import ArrayArm, with_leading_axes
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.arm_with_effects import Arm, affected
from lab.kinematics.effects.effect import FREE_RANGE
from lab.kinematics.effects.effect_registry import effect
from lab.kinematics.effects.range_errors import CONSTANT, SCALE, range_errors
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.noise.error_model import ErrorModel
from lab.noise.variance_components import ComponentErrors
from lab.prediction.arm_on_arrays import ArmOnArrays
from lab.prediction.extrapolation import MeasuredRange
from lab.prediction.point_errors import PredictedPoints, load_errors, predicted_points

__all__ = [
    "SETUP",
    "CarriedLoad",
    "Estimate",
    "EstimatedParameter",
    "IdentifiedSubset",
    "NominalArm",
]

SETUP = ("base", "tool")  # groups of parameters that another setup of the measurement moves
_TURN = ("tool.rx", "tool.ry", "tool.rz")


@dataclass(frozen=True, kw_only=True)
class EstimatedParameter:
    """A parameter as it was identified, or why it was not; the keys of a row of ``parameters.json``, in SI units.

    Attributes:
        nominal: its value in the nominal model, with base and tool fitted.
        exported: its value in the most likely arm among those that predict the same.
        status: ``identified``; ``held`` at nominal on request; ``fixed`` there because an error of it cannot be
            distinguished from others'; ``not seen`` at these poses; None in files that lack it.
        weakly_observable: whether it was identified, but is known no better than to a millimetre or milliradian.
        aliases: of one that is fixed, the parameters that an error of it goes into, and how much of it.
    """

    name: str
    unit: str | None = None
    nominal: float
    estimate: float
    exported: float
    std: float | None = None
    interval_95: tuple[float, ...] | None = None
    status: str | None = None
    weakly_observable: bool = False
    aliases: Mapping[str, float] = field(default_factory=dict)

    @property
    def value(self) -> float:
        """The value as it was fitted; with ``std`` and ``interval_95``."""
        return self.estimate

    @property
    def identified(self) -> bool:
        """Check whether the parameter was identified."""
        return self.status == "identified"

    @property
    def half_width_95(self) -> float:
        """Half of the 95 % interval; NaN where unknown."""
        return float("nan") if self.interval_95 is None else (self.interval_95[1] - self.interval_95[0]) / 2


class NominalArm(Protocol):
    """Robot as an estimate needs it: its joints, its masses, and its geometry with measured targets."""

    @property
    def chain(self) -> JointSpec:
        """The nominal model, whose joints are measured."""

    @property
    def loads(self) -> Loads | None:
        """Masses of the links; None where unknown."""

    def arm(self, targets: tuple[str, ...]) -> RigidArm:
        """Return the arm as equations, with these targets."""


class CarriedLoad(Protocol):
    """Load at the flange, as it was identified."""

    @property
    def mass_kg(self) -> float:
        """Mass of the load."""

    @property
    def covariance(self) -> Array:
        """``(4, 4)`` of mass and first moment, kg and kg m."""


class _Discrepancy(NamedTuple):
    """The model discrepancy within the measured range.

    Attributes:
        sigma_m: one standard deviation of a coordinate.
        inflation: a factor of the parameters' covariance.
        dof: degrees of freedom of the size of both; None where the noise is given.
    """

    sigma_m: float
    inflation: float
    dof: int | None


@dataclass(frozen=True)
class IdentifiedSubset:
    """Subset of the identified parameters, with their covariance by the residuals.

    Attributes:
        names: of the parameters ``(f,)``.
        values: ``(f,)`` in SI units.
        is_angle: ``(f,)`` whether each is an angle, of which whole turns mean nothing.
        dof: degrees of freedom of the noise; None where it was given.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    is_angle: tuple[bool, ...]
    dof: int | None = None


class _Parameters(dict[str, EstimatedParameter]):
    def __missing__(self, name: str) -> EstimatedParameter:
        raise LabError(f"there is no parameter '{name}'; there are {', '.join(self)}")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Estimate(Value, ArmOnArrays):
    """An identified arm, as far as it holds in other sessions.

    Attributes:
        rigid: the geometry of the arm, with the measured targets.
        loads: masses of the robot, payloads where the identified load hangs; None where they are not known.
        effects: names of the groups of effects that last, without that of ``process``.
        left_out: names of the groups of effects of the run's own measurement sessions.
        rows: every parameter of the model that was fitted, in its order, those of ``left_out`` too.
        identified: names of the identified parameters, those of ``left_out`` too.
        covariance: ``(f, f)`` of these; NaN where the noise is unknown.
        noise_m: noise of a coordinate, given or estimated; zero where it is not known.
        residual_m: noise of a coordinate by the residuals; zero where nothing is left over.
        adequate: whether the residuals are no more than the noise; None where that was not tested.
        cluster_robust: whether the covariance is that of whole poses' own residuals.
        tail_dof: degrees of freedom of the noise's tails, of Student's t; None where it is Gaussian.
        shared: errors of a measurement on another day beside the instrument's; None where there are none.
        component_errors: how well the variances of these are known, with slopes by the identified parameters of
            ``arm``; None where they are not estimates.
        process: the offsets of the joints that no group explains; None where they were not fitted.
        measured: the fitted joint positions, and what the model may lack beyond them; None where not known.
        prior_acts_in: in how many directions tolerances of manufacture took part in the fit; None where a run
            does not keep it.
        by_instrument: whether the arm is as the fitted instrument measures it, with the errors of its range.
        checks: of the fit: its convergence, and parameters that these poses do not determine; none of a loaded run.
    """

    rigid: RigidArm
    loads: Loads | None
    effects: tuple[str, ...]
    left_out: tuple[str, ...]
    rows: DeferredField[tuple[EstimatedParameter, ...]] = DeferredField()  # noqa: RUF009
    identified: tuple[str, ...]
    covariance: Array
    noise_m: float
    residual_m: float
    noise_known: bool
    dof: int
    adequate: bool | None
    cluster_robust: bool = False
    tail_dof: float | None = None
    shared: ErrorModel | None = None
    component_errors: ComponentErrors | None = None
    process: JointProcess | None = None
    measured: DeferredField[MeasuredRange | None] = DeferredField(None)  # noqa: RUF009
    load: CarriedLoad | None = None
    prior_acts_in: int | None = None
    by_instrument: bool = False
    checks: tuple[Check, ...] = field(default=(), compare=False)

    def _about(self) -> str:
        return f"{self.rigid.chain.name}, {self.model}, {counted(len(self.identified), 'identified parameter')}"

    def _facts(self) -> Mapping[str, str]:
        return {
            "robot": self.rigid.chain.name,
            "model": self.model,
            "targets": ", ".join(self.rigid.targets),
            "identified parameters": str(len(self.identified)),
            "noise": f"{MM.text(self.noise_m)} per coordinate, {'given' if self.noise_known else 'estimated'}",
        }

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields alone, without what was built from them."""
        return {**super().__getstate__(), "rigid": replace(cast(Any, self.rigid))}

    @cached_property
    def params(self) -> Mapping[str, EstimatedParameter]:
        """The parameters by name; an unknown name is a LabError that lists them."""
        return _Parameters((row.name, row) for row in self.rows)

    @cached_property
    def arm(self) -> Arm:
        """The arm with the effects that last, and with the offsets of its joints that no group explains."""
        lasting = [effect(name, self.rigid.chain, self.loads) for name in self.effects]
        arm = affected(self.rigid, [*(range_errors(FREE_RANGE) if self.by_instrument else ()), *lasting])
        return arm if self.process is None else self.process.added_to(arm)

    @cached_property
    def as_measured(self) -> "Estimate":
        """The estimate of the arm as the fitted instrument measures it; as it is where no range errors were fitted."""
        return replace(self, by_instrument=True) if CONSTANT in self.identified else self

    def with_targets(self, targets: tuple[str, ...]) -> Arm:
        """Return the arm with other targets."""
        return replace(self, rigid=replace(cast(Any, self.rigid), targets=targets)).arm

    def _compiled(self, targets: tuple[str, ...] | None) -> ArrayArm:
        """Build the estimated model, its values as exported; all measured targets unless some are named."""
        if targets is None:
            return ArrayArm(self.arm, self.values, self.nominal)
        if unknown := [name for name in targets if name not in self.rigid.targets]:
            raise LabError(f"target '{unknown[0]}' was not measured; there are {', '.join(self.rigid.targets)}")
        arm = self.with_targets(targets)
        rows = [self.params[name] for name in arm.names]
        return ArrayArm(arm, np.array([row.exported for row in rows]), np.array([row.nominal for row in rows]))

    def predicted_covariance(self, joints: ArrayLike) -> Array:
        """Return the covariance of each predicted point's error, by all causes of ``predict`` together.

        Args:
            joints: ``(..., joints)``, with the conditions of ``inputs`` behind them, if any.

        Returns:
            ``(..., k, 3, 3)`` m²; a new instrument's noise is not in it.

        Raises:
            LabError: the joints have another shape or are not finite.
        """
        rows, leading = self.on_arrays().rows(joints)
        return with_leading_axes(leading, self.predict(rows).covariance)

    @property
    def groups(self) -> tuple[str, ...]:
        """The names of the groups of effects that the arm has."""
        return self.arm.groups

    @property
    def model(self) -> str:
        """The groups of the arm's model, joined by +."""
        return "+".join(("geometric", *self.groups))

    @property
    def names(self) -> tuple[str, ...]:
        """Names ``(p,)`` of the arm's parameters."""
        return self.arm.names

    @cached_property
    def values(self) -> Array:
        """Parameters ``(p,)`` of the arm in the order of ``names``: the most likely of those that predict the same."""
        return np.array([self.params[name].exported for name in self.arm.names])

    @cached_property
    def nominal(self) -> Array:
        """Parameters ``(p,)`` of the nominal arm, with the base and tool that suit it best."""
        return np.array([self.params[name].nominal for name in self.arm.names])

    @cached_property
    def R_last_tool(self) -> Array:
        """Rotation ``(3, 3)`` of the measured tool in the last frame; one where no orientation was measured."""
        measured = set(_TURN) <= set(self.params)
        return se3.exp(np.array([self.params[name].exported for name in _TURN]) if measured else np.zeros(3))

    @cached_property
    def _lasting(self) -> tuple[int, ...]:
        return tuple(i for i, name in enumerate(self.identified) if name in self.arm.names)

    @property
    def free_names(self) -> tuple[str, ...]:
        """Names ``(g,)`` of the identified parameters of the arm."""
        return tuple(self.identified[i] for i in self._lasting)

    @property
    def free(self) -> tuple[int, ...]:
        """Indices ``(g,)`` of the identified parameters among the arm's parameters."""
        return tuple(self.arm.names.index(name) for name in self.free_names)

    @property
    def free_covariance(self) -> Array:
        """Covariance ``(g, g)`` of the identified parameters of the arm."""
        return np.asarray(self.covariance[np.ix_(self._lasting, self._lasting)])

    @property
    def shifts_by_range(self) -> Array:
        """Shifts ``(g, 2)`` of the identified parameters of the arm by independent range errors of one sigma each.

        The first is that of the constant, the second what the scale adds; none, ``(g, 0)``, where they were not fitted.
        With C the covariance of both, and c that with the parameters, they are c L'^-1, where L L' = C.
        """
        of_range = [i for i, name in enumerate(self.identified) if name in (CONSTANT, SCALE)]
        own = self.covariance[np.ix_(of_range, of_range)]
        shared = self.covariance[np.ix_(self._lasting, of_range)]
        return np.asarray(np.linalg.solve(np.linalg.cholesky(own), shared.T).T) if of_range else shared

    @property
    def geometry(self) -> tuple[RigidArm, Array]:
        """The arm without its effects, and its parameters as exported."""
        return self.rigid, self.values[: len(self.rigid.names)]

    def geometry_error(self, inputs: Array, target: int | None = None) -> float | None:
        """Return the error of the geometry alone, without effects (m, root mean square over poses and points).

        Args:
            inputs: ``(n, joints + conditions)`` the poses.
            target: the one point of the arm that counts; all where not given.

        Returns:
            None where the arm has no effects, or there are no poses.
        """
        if not self.groups or not len(inputs):
            return None
        arm, values = self.geometry
        off = self.arm.points(inputs, self.values) - arm.points(inputs[:, : arm.chain.size], values)
        squares = (off**2).sum(axis=2)[:, slice(None) if target is None else target]
        return float(np.sqrt(np.nanmean(squares)))

    def nominal_inverse(self, target: int) -> NominalInverse:
        """Return the inverse kinematics of the nominal model that a controller uses for a target."""
        return NominalInverse(self.rigid, self.nominal[: len(self.rigid.names)], target)

    @property
    def compliance(self) -> Array:
        """Compliances ``(joints,)`` rad/Nm (m/N) of the joints; zero of joints without one."""
        found = dict(zip(self.arm.names, self.values.tolist(), strict=True))
        return np.array([found.get(f"joint{i + 1}.compliance", 0.0) for i in range(self.rigid.chain.size)])

    def discrepancy(self, sigma_m: float | None = None) -> _Discrepancy:
        """Return the model discrepancy, taken from the residuals where they are more than noise.

        Args:
            sigma_m: noise of new measurements; that of the fit where not given.
        """
        sigma_m = self.noise_m if sigma_m is None else sigma_m
        if self.shared is not None:  # the residuals are those of the error model
            return _Discrepancy(0.0, 1.0, self.dof)
        if self.noise_known and self.adequate is not False:
            return _Discrepancy(0.0, 1.0, None)
        noise_m = self.noise_m if self.noise_known else sigma_m
        by_noise = self.noise_known and not self.cluster_robust
        inflation = (self.residual_m / noise_m) ** 2 if by_noise else 1.0
        return _Discrepancy(float(np.sqrt(max(self.residual_m**2 - noise_m**2, 0.0))), inflation, self.dof)

    def subset(self, without: Sequence[str] = SETUP) -> IdentifiedSubset:
        """Return the identified parameters of the arm but for some groups, by default those of the setup."""
        parameters = {each.name: each for each in self.arm.parameters}
        names = tuple(name for name in self.free_names if parameters[name].group not in without)
        rows = [self.identified.index(name) for name in names]
        _, inflation, dof = self.discrepancy()
        values = np.array([self.params[name].estimate for name in names])
        angles = tuple(parameters[name].is_angle for name in names)
        return IdentifiedSubset(names, values, inflation * self.covariance[np.ix_(rows, rows)], angles, dof)

    def extrapolated(self, joints: Array) -> NDArray[np.bool_]:
        """Find the positions among ``(n, joints)`` that no fitted pose is near, where the model lacks something.

        Nowhere for a run that does not keep its poses.
        """
        measured = self.measured
        if measured is None or not (measured.is_worse_beyond or self.process is not None):
            return np.zeros(len(joints), dtype=np.bool_)
        return measured.uncovered(joints)

    @cached_property
    def predicted_by(self) -> PredictedBy | None:
        """The covariances of predicted points where the joints' offsets are predicted too; else None."""
        if self.process is None:
            return None
        measured = self.arm.targets[: self.process.seen.shape[1]]  # behind them there may be points that were not
        arm = replace(self, rigid=replace(cast(Any, self.rigid), targets=measured), process=None).arm
        free = tuple(arm.names.index(name) for name in self.free_names)
        return PredictedBy(self.process, arm, np.array([self.params[name].exported for name in arm.names]), free)

    def predict(self, inputs: ArrayLike, targets: NDArray[np.int_] | None = None) -> PredictedPoints:
        """Predict the measured points at poses, with the covariance of each one's error by its cause.

        Args:
            inputs: ``(n, joints + conditions)`` of the arm: rad (m of a slide), then ``arm.conditions``; one pose may
                be given without its axis, and is predicted as the first of one.
            targets: ``(n,)`` one target of each pose; all of every pose where not given.

        Raises:
            LabError: the inputs have another number of columns.
        """
        inputs = np.atleast_2d(np.asarray(inputs, dtype=np.float64))
        width = self.rigid.chain.size + len(self.arm.conditions)
        if inputs.ndim != 2 or inputs.shape[1] != width:
            raise LabError(f"inputs have shape {inputs.shape}; give ({width},) or (n, {width})")
        return predicted_points(self, inputs, targets)

    def load_errors(self, inputs: Array, targets: Sequence[int]) -> Array:
        """Return errors ``(n, k)`` (m, root mean square) of some targets by the uncertainty of an identified load."""
        return load_errors(self, inputs, targets)
