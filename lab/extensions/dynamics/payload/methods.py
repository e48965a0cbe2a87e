"""Identify a payload from the arm's sag, from torques, or from a wrench sensor."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.filtering import BAND_HZ, Band, band_of
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate, estimate_of, excitation_advice
from lab.extensions.dynamics.regression import (
    BiasCandidate,
    ChannelSolution,
    EvenSamples,
    check_residuals,
    least_squares,
)
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.dynamics.rigid_body import (
    LOAD,
    Dynamics,
    HandMotion,
    diagonal_matrices,
    hand_motion,
    torque_regressor,
    wrench_regressor,
)
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["CompliantArm", "from_sag", "from_torques", "from_wrench"]

_MAX_SAG_ITERATIONS, _SAG_STEP = 20, 1e-9  # kg, kg m
_NEWTON = 4


@dataclass(frozen=True)
class CompliantArm:
    """An arm with compliant joints.

    Attributes:
        compliance: ``(J,)`` rad/Nm (m/N of a slide), zero of stiff joints.
        loads: its own masses, with gravity in frame 0.
    """

    compliance: Array
    loads: Loads


def from_sag(
    arm: SerialArm,
    values: Array,
    soft: CompliantArm,
    joints: Array,
    unloaded: Array,
    loaded: Array,
) -> LoadEstimate:
    """Estimate mass and centre of mass from the targets' positions without and with the load, at equal joint positions.

    The joints stand at q + d with d = C (g(q + d) - W(q + d) phi), by the arm's own weight g and the static columns
    of the load's regressor; Gauss-Newton in phi, the equilibrium solved at each step.

    Args:
        joints: joint positions ``(n, J)``.
        unloaded, loaded: ``(n, k, 3)`` m, in the tracker's frame; poses with a NaN are left out.

    Raises:
        LabError: too few poses, or no compliance.
    """
    if not np.any(soft.compliance):
        raise LabError(
            "no joint has a compliance: a stiff arm shows no load by its sag; identify the compliances first"
        )
    both = np.isfinite(unloaded).all(axis=(1, 2)) & np.isfinite(loaded).all(axis=(1, 2))
    if not both.any():
        raise LabError("no pose was seen both with and without the load: measure the same poses twice")
    joints, seen = joints[both], (loaded - unloaded)[both].reshape(int(both.sum()), -1)
    without = joints + _sag(arm, values, soft, joints, np.zeros(10))[0]
    before, phi = arm.points(without, values).reshape(seen.shape), np.zeros(10)
    for _ in range(_MAX_SAG_ITERATIONS):
        sag, slopes = _sag(arm, values, soft, joints, phi)
        lever = arm.joint_jacobian(joints + sag, values).reshape(*seen.shape, -1)
        columns = lever @ slopes
        left = seen - (arm.points(joints + sag, values).reshape(seen.shape) - before) + columns @ phi
        solution = least_squares(LOAD, columns, left, [0] * seen.shape[1])
        step, phi = np.abs(solution.values - phi).max(), solution.values
        if step < _SAG_STEP:
            break
    bend = lever * (sag + joints - without)[:, None, :]
    check = check_residuals(solution, [BiasCandidate(bend, "compliance")])
    unidentified = excitation_advice(solution, False, arm, values, joints)
    return estimate_of("sag", solution, {}, unidentified, check, float(np.sqrt(2)))


def _sag(arm: SerialArm, values: Array, soft: CompliantArm, joints: Array, phi: Array) -> tuple[Array, Array]:
    """Solve for joint deflections ``(n, J)`` and their derivatives by phi ``(n, J, 10)``, by Newton's method."""
    mass, centre = soft.loads.mass_kg.copy(), soft.loads.centre_m.copy()
    mass[-1] += phi[0]
    if mass[-1]:
        centre[-1] = (soft.loads.mass_kg[-1] * soft.loads.centre_m[-1] + phi[1:4]) / mass[-1]
    together = replace(soft.loads, mass_kg=mass, centre_m=centre)
    rest, still = together.equilibrium(joints, soft.compliance, np.zeros(len(joints)), _NEWTON), np.zeros_like(joints)
    regressor = torque_regressor(arm, values, joints + rest.offset, still, still, soft.loads.gravity)
    slopes: Array = np.linalg.solve(rest.equations, -soft.compliance[:, None] * regressor).astype(float)
    return rest.offset, slopes


_MAX_DISTANCE = 0.01  # rad or m root mean square: the weight of an arm's own links changes by half a Nm over that
_SAME_STEP = 0.01  # of a time step
_ROUNDING = 1e-9  # of a root mean square of some thousand readings


@dataclass(frozen=True)
class _PairedRuns:
    """The two runs at the file's step, and decimated (k rows).

    Attributes:
        joints, direction: ``(n, J)`` readings of the loaded run, and the signs of their speeds.
        torque: ``(n, J)`` loaded less unloaded, as recorded.
        unloaded: ``(n, J)`` the joints' torques without the load: by the arm's own dynamics, or else as recorded.
        own: ``(k, J)`` the arm's own dynamics, loaded less unloaded; zero without them.
        regressor: ``(n, J, 10)``.
        thinned: ``(3, k, J, 10)``, the regressor with its first two derivatives in time.
        apart: ``(k, J, 3 J)`` columns of the two paths' differences in reading, speed and acceleration.
    """

    band: Band
    joints: Array
    direction: Array
    torque: Array
    unloaded: Array
    own: Array
    regressor: Array
    thinned: Array
    apart: Array

    def seen(self, late_s: float) -> Array:
        """Return the load's torques ``(k, J)``, if torques lag the positions by this time."""
        return self.band.decimated(self.torque, late_s) - self.own

    def rubbing(self, phi: Array) -> Array:
        """Return columns ``(3, k, J, J)`` of friction that grows with the load, and derivatives as of ``thinned``.

        (|loaded| - |unloaded|) sign(speed), where loaded is unloaded plus what the load found, ``phi``, would add:
        as recorded, its noise would be that of the difference which the columns are to explain.
        """
        more = np.abs(self.unloaded + self.regressor @ phi) - np.abs(self.unloaded)
        return np.array(
            [diagonal_matrices(self.band.decimated(more * self.direction, order=order)) for order in range(3)]
        )


def _pair_runs(
    arm: SerialArm,
    values: Array,
    loaded: PayloadSamples,
    unloaded: PayloadSamples,
    gravity: Array,
    own: Dynamics | None,
) -> _PairedRuns:
    """Bring two runs together, row by row from their beginnings."""
    assert loaded.torques is not None and unloaded.torques is not None and loaded.time_s is not None
    n = min(len(loaded), len(unloaded))
    band = band_of(loaded.time_s[:n], BAND_HZ)
    _same_step(band, unloaded)
    motion, other = (band.motion(run.joints[:n]) for run in (loaded, unloaded))
    _refuse_apart(arm, motion[0] - other[0], own)
    regressor = torque_regressor(arm, values, *motion, gravity)
    alone = own(*other) if own else band.smoothed(unloaded.torques[:n])
    more = own(*motion) - alone if own else np.zeros_like(motion[0])
    apart = np.concatenate(
        [diagonal_matrices(band.decimated(a - b)) for a, b in zip(motion, other, strict=True)], axis=2
    )
    thinned = np.array([band.decimated(regressor, order=order) for order in range(3)])
    return _PairedRuns(
        band, motion[0], np.sign(motion[1]), band.trimmed(loaded.torques[:n] - unloaded.torques[:n]), alone,
        band.decimated(more), regressor, thinned, apart,
    )  # fmt: skip


def _same_step(band: Band, unloaded: PayloadSamples) -> None:
    """Refuse an unloaded run with another time step than the loaded one's."""
    step = unloaded.step_s or 0.0
    if abs(step / band.step_s - 1) > _SAME_STEP:
        raise LabError(f"time steps of {band.step_s:g} s loaded and {step:g} s unloaded: give the same")


def _refuse_apart(arm: SerialArm, difference: Array, own: Dynamics | None) -> None:
    """Refuse paths whose readings differ ``(n, J)`` by too much for a fit without the arm's own dynamics."""
    apart = np.sqrt((difference**2).mean(axis=0))
    j = int(np.argmax(apart >= (1 - _ROUNDING) * apart.max()))  # the first of joints that are equally far apart
    if own is None and apart[j] > _MAX_DISTANCE:
        raise LabError(
            f"the loaded and the unloaded path are {arm.chain.shown(j, apart[j])} apart at joint "
            f"{arm.chain.joint_names[j]} (root mean square; {arm.chain.shown(j, _MAX_DISTANCE)} at most): repeat the "
            "same path, or have the arm's own dynamics subtracted"
        )


_MAX_TORQUE_ITERATIONS, _TORQUE_STEP = 10, 1e-6  # of the nuisances: seconds, and shares of a torque


def from_torques(
    arm: SerialArm,
    values: Array,
    records: PayloadSamples,
    gravity: Array,
    *,
    own: Dynamics | None = None,
    friction: bool = False,
    delay: bool = False,
) -> LoadEstimate:
    """Estimate the load from differences of torques, row by row of the two runs; four parameters of static poses.

    Args:
        gravity: ``(3,)`` m/s^2 in frame 0.
        own: subtracted from each run along its own path, so that paths may differ.
        friction: fit each joint's share of torque lost to friction: (|loaded| - |unloaded|) sign(speed).
            Give ``own`` with it where the joints' friction without a load is not small beside their torques.
        delay: fit the delay of the torques after the positions, the same of all joints.

    Raises:
        LabError: no torques, no or unequal runs, too few samples, paths too far apart for a run without ``own``.
    """
    loaded, unloaded = _runs(records)
    if records.time_s is None:
        if friction or delay:
            raise LabError("static poses show no friction or delay: leave these options out, or record a motion")
        return _static(arm, values, loaded, unloaded, gravity, own)
    runs = _pair_runs(arm, values, loaded, unloaded, gravity, own)
    names = arm.chain.joint_names if friction else ()
    reading = float(np.sqrt(2) * np.linalg.norm(runs.band.impulse))
    solution, late, columns = _fitted(runs, names, delay)
    fitted = solution.values[: columns.shape[3]]
    candidates = [
        BiasCandidate((columns[2, ..., :10] @ fitted[:10])[..., None], "difference.filter"),
        BiasCandidate(runs.apart, "unequal_paths"),
    ]
    if not delay:
        candidates.append(BiasCandidate((columns[1] @ fitted)[..., None], "difference.delay"))
    if not friction:
        candidates.append(BiasCandidate(runs.rubbing(fitted[:10])[0], "difference.friction"))
    nuisance = {name: (float(value), "") for name, value in zip(solution.names[10:], solution.values[10:], strict=True)}
    nuisance |= {"delay": (late, "s")} if delay else {}
    unidentified = excitation_advice(solution, True, arm, values, runs.joints)
    check = check_residuals(solution, candidates, [EvenSamples(0, len(runs.own), runs.band.hz)])
    times = runs.band.times(len(runs.own))
    return estimate_of("torque difference, moving", solution, nuisance, unidentified, check, reading, times)


def _fitted(runs: _PairedRuns, joint_names: Sequence[str], delay: bool) -> tuple[ChannelSolution, float, Array]:
    """Iterate Gauss-Newton steps of the delay, while the columns of friction follow the estimated load.

    With y(t + late) = X(t) p, where X holds the regressor and the friction's columns, a step of the delay has the
    column -X' p.

    Returns:
        The last step's solution, whose delay is that step; the delay (s); and X with its first two derivatives in
        time, ``(3, k, J, c)``.
    """
    labels = [*LOAD, *(f"friction.{name}" for name in joint_names), *(["delay"] if delay else [])]
    columns, late = runs.thinned, 0.0
    solution = least_squares(LOAD, columns[0], runs.seen(late), [0] * runs.own.shape[1])
    fitted = np.concatenate([solution.values, np.zeros(len(joint_names))])
    for _ in range(_MAX_TORQUE_ITERATIONS if len(labels) > len(LOAD) else 0):
        if joint_names:
            columns = np.concatenate([runs.thinned, runs.rubbing(fitted[:10])], axis=3)
        step = [-(columns[1] @ fitted)[..., None]] if delay else []
        design = np.concatenate([columns[0], *step], axis=2)
        solution = least_squares(labels, design, runs.seen(late), [0] * runs.own.shape[1])
        before, fitted = fitted, solution.values[: len(fitted)]
        moved = np.abs(fitted - before)[10:].max(initial=0.0)
        if delay:
            late += float(solution.values[-1])
            moved = max(moved, abs(float(solution.values[-1])))
        if moved < _TORQUE_STEP:
            break
    if abs(late) > runs.band.every * runs.band.step_s:
        raise LabError(f"a delay of {1e3 * late:.3g} ms is too long: align torques and positions first")
    return solution, late, columns


def _static(
    arm: SerialArm,
    values: Array,
    loaded: PayloadSamples,
    unloaded: PayloadSamples,
    gravity: Array,
    own: Dynamics | None,
) -> LoadEstimate:
    assert loaded.torques is not None and unloaded.torques is not None
    if len(loaded) != len(unloaded):
        raise LabError(
            f"{len(loaded)} loaded static poses and {len(unloaded)} unloaded ones: give both at each pose, in one order"
        )
    still = np.zeros_like(loaded.joints)
    _refuse_apart(arm, loaded.joints - unloaded.joints, own)
    regressor = torque_regressor(arm, values, loaded.joints, still, still, gravity)
    seen = loaded.torques - unloaded.torques
    if own:
        seen = seen - (own(loaded.joints, still, still) - own(unloaded.joints, still, still))
    solution = least_squares(LOAD, regressor, seen, [0] * seen.shape[1])
    steady = np.broadcast_to(np.eye(seen.shape[1]), (*seen.shape, seen.shape[1]))
    candidates = [
        BiasCandidate(steady, "difference.constant"),
        BiasCandidate(diagonal_matrices(regressor @ solution.values), "difference.gains"),
    ]
    unidentified = excitation_advice(solution, False, arm, values, loaded.joints)
    check = check_residuals(solution, candidates)
    return estimate_of("torque difference, static", solution, {}, unidentified, check, float(np.sqrt(2)))


def _runs(records: PayloadSamples) -> tuple[PayloadSamples, PayloadSamples]:
    if records.torques is None:
        raise LabError("there are no torques: give those of every joint, or identify from the wrench")
    loaded, unloaded = records.run(True), records.run(False)
    for run, name in ((loaded, "loaded"), (unloaded, "unloaded")):
        if not len(run):
            raise LabError(f"there is no {name} run: torques are compared with and without the load; record both")
    return loaded, unloaded


_WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
_OFFSETS = tuple(f"offset.{name}" for name in _WRENCH)
_TILT, _TURN = ("tilt.x", "tilt.y"), ("turn.x", "turn.y", "turn.z")
_UNITS = {"offset.f": "N", "offset.m": "Nm", "tilt": "rad", "turn": "rad", "delay": "s"}
_FORCE_AND_MOMENT = (0, 0, 0, 1, 1, 1)  # one noise each, where there are too few poses for six
_MAX_WRENCH_ITERATIONS, _WRENCH_STEP = 20, 1e-10  # rad and s


@dataclass(frozen=True)
class _MountingEstimate:
    """Estimated mounting of arm and sensor.

    Attributes:
        gravity: ``(3,)`` m/s^2 in frame 0.
        rotation: ``(3, 3)`` of the sensor's axes in the last frame.
        tilt: ``(2,)`` rad by which frame 0 is tilted beyond the given tilt: about its x, made horizontal, and across.
        late_s: how much later the wrench is than the positions.
    """

    gravity: Array
    rotation: Array
    tilt: Array
    late_s: float = 0.0


@dataclass(frozen=True)
class _LoadReadings:
    """Wrist-sensor readings and their regressors, filtered and decimated if the run was a motion.

    Attributes:
        raw: ``(n, 6)`` of the loaded run, for the hand on the load.
        still: ``(m, 6)`` of the unloaded run, decimated: offsets alone.
        at_rest: ``(3, k, 6, 10)`` the regressor without gravity, with its first two derivatives in time.
        by_gravity: ``(3, k, 6, 10, 3)`` the contribution of each component of gravity in frame 0.
    """

    band: Band | None
    raw: Array
    still: Array
    at_rest: Array
    by_gravity: Array

    def series(self, rows: int) -> list[EvenSamples]:
        """Return the two runs among so many rows, if they move."""
        if self.band is None:
            return []
        k = self.at_rest.shape[1]
        ends = [(0, k), (k, rows)] if rows > k else [(0, k)]
        return [EvenSamples(first, last, self.band.hz) for first, last in ends]

    def times(self, rows: int) -> Array | None:
        """Return the times ``(rows,)`` s of the two runs' rows, each from its beginning on; None of static poses."""
        if self.band is None:
            return None
        k = self.at_rest.shape[1]
        return np.concatenate([self.band.times(k), self.band.times(rows - k, 0)])

    def seen(self, late_s: float) -> Array:
        """Return the wrench ``(k, 6)``, at this delay after the positions."""
        return self.raw if self.band is None else self.band.decimated(self.raw, late_s)


def from_wrench(
    arm: SerialArm,
    values: Array,
    records: PayloadSamples,
    mounting: Mounting,
    *,
    tilt: bool = False,
    turn: bool = False,
    delay: bool = False,
) -> LoadEstimate:
    """Estimate the load and six offsets from the wrench of the loaded run; four parameters of static poses.

    An unloaded run shows the offsets only: nothing may hang from the sensor then.

    Args:
        mounting: nominal mounting of arm and sensor, and the sensor's sign.
        tilt: fit the tilt of frame 0 beyond ``mounting``.
        turn: fit the turn of the sensor beyond ``mounting``.
        delay: fit the delay of the wrench after the positions.

    Raises:
        LabError: no wrench, no loaded run, too few samples, or it does not converge.
    """
    moving = records.time_s is not None
    _refuse_wrench(records, delay and not moving)
    readings = _readings(arm, values, records, mounting)
    labels = [*LOAD, *_OFFSETS, *(_TILT if tilt else ()), *(_TURN if turn else ()), *(("delay",) if delay else ())]
    reading = float(np.linalg.norm(readings.band.impulse)) if readings.band else 1.0
    solution, mounted = _fitted_to_wrench(readings, labels, mounting)
    series = readings.series(len(solution.residual))
    check = check_residuals(solution, _candidates(readings, solution, mounted, labels), series)
    turned = se3.log(mounting.rotation.T @ mounted.rotation)
    beside = [
        *(mounting.sign * solution.values[10:16]),
        *(mounted.tilt if tilt else ()),
        *(turned if turn else ()),
        mounted.late_s,
    ]
    nuisance = {name: (float(value), _unit(name)) for name, value in zip(labels[10:], beside, strict=False)}
    unidentified = excitation_advice(solution, moving, arm, values, records.joints[records.loaded])
    kind, times = f"wrench, {'moving' if moving else 'static'}", readings.times(len(solution.residual))
    return estimate_of(kind, solution, nuisance, unidentified, check, reading, times)


def _refuse_wrench(records: PayloadSamples, static_delay: bool) -> None:
    """Refuse records that do not show the load, or the delay."""
    if records.wrench is None:
        raise LabError("there is no wrench: give a sensor's fx_n to mz_nm, or identify from the torques")
    if not records.loaded.any():
        raise LabError("there is no loaded run: record the wrench with the payload at the flange")
    if static_delay:
        raise LabError("static poses show no delay: leave the option out, or record a motion")


def _readings(arm: SerialArm, values: Array, records: PayloadSamples, mounting: Mounting) -> _LoadReadings:
    loaded, unloaded = records.run(True), records.run(False)
    assert loaded.wrench is not None and unloaded.wrench is not None
    raw, still = mounting.sign * loaded.wrench, mounting.sign * unloaded.wrench
    if loaded.time_s is None:
        zero = np.zeros_like(loaded.joints)
        regressors = _regressors(hand_motion(arm, values, loaded.joints, zero, zero))
        return _LoadReadings(None, raw, still, *(np.array([part, 0 * part, 0 * part]) for part in regressors))
    band = band_of(loaded.time_s, BAND_HZ)
    regressors = _regressors(hand_motion(arm, values, *band.motion(loaded.joints)))
    if len(unloaded) and unloaded.time_s is not None:
        _same_step(band, unloaded)
        still = band_of(unloaded.time_s, BAND_HZ).decimated(still)
    parts = (np.array([band.decimated(part, order=order) for order in range(3)]) for part in regressors)
    return _LoadReadings(band, band.trimmed(raw), still, *parts)


def _regressors(motion: HandMotion) -> tuple[Array, Array]:
    """Return the regressor without gravity ``(n, 6, 10)``, and the part of each gravity component ``(n, 6, 10, 3)``."""
    zero = np.zeros_like(motion.omega)
    hanging = replace(motion, omega=zero, alpha=zero, acceleration=zero)
    return wrench_regressor(motion, np.zeros(3)), np.stack([wrench_regressor(hanging, axis) for axis in np.eye(3)], -1)


def _fitted_to_wrench(
    readings: _LoadReadings, labels: Sequence[str], mounting: Mounting
) -> tuple[ChannelSolution, _MountingEstimate]:
    """Iterate Gauss-Newton steps of the mounting and the delay; the other parameters are linear."""
    mounted = _MountingEstimate(mounting.gravity, mounting.rotation, np.zeros(2))
    linear = labels[:16]
    seen = np.concatenate([readings.seen(0.0), readings.still])
    solution = least_squares(linear, _columns(readings, mounted), seen, _FORCE_AND_MOMENT)
    for _ in range(_MAX_WRENCH_ITERATIONS if len(labels) > len(linear) else 0):
        freed = _freed(readings, mounted, solution.values[:10])
        design = np.concatenate([_columns(readings, mounted), *(freed[name] for name in labels[16:])], axis=2)
        seen = np.concatenate([readings.seen(mounted.late_s), readings.still])
        solution = least_squares(labels, design, seen, _FORCE_AND_MOMENT)
        mounted = _stepped(mounted, dict(zip(labels, solution.values, strict=True)))
        if np.abs(solution.values[16:]).max() < _WRENCH_STEP:
            return solution, mounted
    if len(labels) > len(linear) and np.abs(solution.values[16:]).max() > 1e-6:
        raise LabError("tilt, mounting or delay do not converge: align arm, sensor and clock better, or free fewer")
    return solution, mounted


def _loaded(readings: _LoadReadings, mounted: _MountingEstimate, order: int = 0) -> Array:
    """Return the load's columns ``(k, 6, 10)`` in the sensor's axes."""
    return _turned(mounted, readings.at_rest[order] + readings.by_gravity[order] @ mounted.gravity)


def _columns(readings: _LoadReadings, mounted: _MountingEstimate) -> Array:
    """Return the regressor of the load and the offsets, ``(k + m, 6, 16)``."""
    columns = _padded(readings, _loaded(readings, mounted))
    return np.concatenate([columns, np.broadcast_to(np.eye(6), (len(columns), 6, 6))], axis=2)


def _freed(readings: _LoadReadings, mounted: _MountingEstimate, phi: Array) -> dict[str, Array]:
    """Return by name one column ``(k + m, 6, 1)`` of each iterated parameter, at a load ``phi``.

    Frame 0 tilted by d turns gravity in it by -d, and a sensor turned by d reads w - d x w.
    """
    wrench = _loaded(readings, mounted) @ phi
    columns = {}
    for name, axis in zip(_TILT, _horizontal(mounted.gravity), strict=True):
        columns[name] = _turned(mounted, readings.by_gravity[0] @ np.cross(mounted.gravity, axis)) @ phi
    for name, axis in zip(_TURN, np.eye(3), strict=True):
        columns[name] = np.cross(wrench.reshape(-1, 2, 3), axis).reshape(-1, 6)
    columns["delay"] = -_loaded(readings, mounted, 1) @ phi
    return {name: _padded(readings, column[..., None]) for name, column in columns.items()}


def _stepped(mounted: _MountingEstimate, steps: dict[str, float]) -> _MountingEstimate:
    tilt = np.array([steps.get(name, 0.0) for name in _TILT])
    turn = np.array([steps.get(name, 0.0) for name in _TURN])
    return _MountingEstimate(
        se3.exp(-tilt @ _horizontal(mounted.gravity)) @ mounted.gravity,
        mounted.rotation @ se3.exp(turn),
        mounted.tilt + tilt,
        mounted.late_s + float(steps.get("delay", 0.0)),
    )


def _candidates(
    readings: _LoadReadings, solution: ChannelSolution, mounted: _MountingEstimate, labels: Sequence[str]
) -> list[BiasCandidate]:
    phi = solution.values[:10]
    freed = _freed(readings, mounted, phi)
    named = {
        _TILT: "sensor.base_tilt",
        _TURN: "sensor.mounting",
        ("delay",): "sensor.delay",
    }
    candidates = [
        BiasCandidate(np.concatenate([freed[name] for name in names], axis=2), effect)
        for names, effect in named.items()
        if names[0] not in labels
    ]
    wrench = _padded(readings, (_loaded(readings, mounted) @ phi)[:, :, None] * np.eye(6))
    candidates.append(BiasCandidate(wrench, "sensor.scale"))
    bent = _loaded(readings, mounted, 2) @ phi
    candidates.append(BiasCandidate(_padded(readings, bent[..., None]), "sensor.filter"))
    return candidates


def _unit(name: str) -> str:
    return next(unit for start, unit in _UNITS.items() if name.startswith(start))


def _horizontal(gravity: Array) -> NDArray[np.float64]:
    """Return frame 0's x (its y where x is upright) made horizontal, and the axis across: rows ``(2, 3)``."""
    up = -gravity / np.linalg.norm(gravity)
    x = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    x = x - (x @ up) * up
    x = x / np.linalg.norm(x)
    return np.array([x, np.cross(up, x)])


def _turned(mounted: _MountingEstimate, columns: Array) -> Array:
    """Turn forces and moments ``(k, 6, ...)`` from the last frame's axes to the sensor's."""
    halves = columns.reshape(len(columns), 2, 3, -1)
    turned: Array = np.einsum("ji,nhjc->nhic", mounted.rotation, halves)
    return turned.reshape(columns.shape)


def _padded(readings: _LoadReadings, columns: Array) -> Array:
    """Append rows of zeros for the unloaded run, in which nothing hangs from the sensor."""
    return np.concatenate([columns, np.zeros((len(readings.still), *columns.shape[1:]))])
