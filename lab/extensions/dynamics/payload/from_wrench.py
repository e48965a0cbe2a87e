"""A load from what a sensor at the wrist reads: its wrench, with offsets, and if asked how arm and sensor stand."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.filtering import BAND_HZ, Band, band_of
from lab.extensions.dynamics.load_samples import Mounting, PayloadSamples
from lab.extensions.dynamics.payload.estimate import LoadEstimate, estimate_of, excitation_advice
from lab.extensions.dynamics.payload.paired_runs import same_step
from lab.extensions.dynamics.regression import BiasCandidate, ChannelSolution, Series, least_squares, verdict
from lab.kinematics.dynamics.rigid_body import LOAD, HandMotion, hand_motion, wrench_regressor
from lab.kinematics.serial.arm import SerialArm

__all__ = ["from_wrench"]

_WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
_OFFSETS = tuple(f"offset.{name}" for name in _WRENCH)
_TILT, _TURN = ("tilt.x", "tilt.y"), ("turn.x", "turn.y", "turn.z")
_UNITS = {"offset.f": "N", "offset.m": "Nm", "tilt": "rad", "turn": "rad", "delay": "s"}
_FORCE_AND_MOMENT = (0, 0, 0, 1, 1, 1)  # one noise each, where there are too few poses for six
_ROUNDS, _SETTLED = 20, 1e-10  # rad and s


@dataclass(frozen=True)
class _MountingEstimate:
    """How arm and sensor stand, as far as it is estimated.

    Attributes:
        gravity: ``(3,)`` m/s^2 in frame 0.
        rotation: ``(3, 3)`` of the sensor's axes in the last frame.
        tilt: ``(2,)`` rad by which frame 0 is tilted beyond what was told: about its x, made horizontal, and across.
        late_s: how much later the wrench is than the positions.
    """

    gravity: Array
    rotation: Array
    tilt: Array
    late_s: float = 0.0


@dataclass(frozen=True)
class _Readings:
    """What the sensor read and what it was to read, thinned if it was a motion.

    Attributes:
        raw: ``(n, 6)`` of the loaded run, for the hand on the load.
        still: ``(m, 6)`` of the unloaded run, thinned: offsets alone.
        at_rest: ``(3, k, 6, 10)`` the regressor without gravity, with its first two derivatives in time.
        by_gravity: ``(3, k, 6, 10, 3)`` what each component of gravity in frame 0 adds.
    """

    band: Band | None
    raw: Array
    still: Array
    at_rest: Array
    by_gravity: Array

    def series(self, rows: int) -> list[Series]:
        """The two runs among so many rows, if they move."""
        if self.band is None:
            return []
        k = self.at_rest.shape[1]
        ends = [(0, k), (k, rows)] if rows > k else [(0, k)]
        return [Series(first, last, self.band.hz) for first, last in ends]

    def seen(self, late_s: float) -> Array:
        """The wrench ``(k, 6)``, if it is so much later than the positions."""
        return self.raw if self.band is None else self.band.kept(self.raw, late_s)


def from_wrench(
    arm: SerialArm,
    values: Array,
    records: PayloadSamples,
    mounting: Mounting,
    *,
    tilt: bool = False,
    turn: bool = False,
    delay: bool = False,
    sigma: Array | None = None,
    band_hz: float = BAND_HZ,
) -> LoadEstimate:
    """The load from the wrench of the loaded run, six offsets always fitted along; four parameters of static poses.

    An unloaded run, where there is one, tells of the offsets only: nothing may hang from the sensor then.

    Args:
        mounting: how arm and sensor stand, and the sensor's sign.
        tilt: fit how frame 0 is tilted beyond what ``mounting`` says.
        turn: fit how the sensor is turned beyond that.
        delay: fit how much later the wrench is than the positions.
        sigma: ``(6,)`` N and Nm of one reading; else it is estimated.
        band_hz: of the filter in which a motion is compared.

    Raises:
        LabError: no wrench, no loaded run, too few samples, or it does not converge.
    """
    if records.wrench is None:
        raise LabError("there is no wrench: give a sensor's fx_n to mz_nm, or identify from the torques")
    if not records.loaded.any():
        raise LabError("there is no loaded run: record the wrench with the payload at the flange")
    moving = records.time_s is not None
    if delay and not moving:
        raise LabError("static poses show no delay: leave the option out, or record a motion")
    readings = _readings(arm, values, records, mounting, band_hz)
    labels = [*LOAD, *_OFFSETS, *(_TILT if tilt else ()), *(_TURN if turn else ()), *(("delay",) if delay else ())]
    reading = float(np.linalg.norm(readings.band.impulse)) if readings.band else 1.0
    known = None if sigma is None else reading * np.asarray(sigma)
    solution, standing = _fitted(readings, labels, mounting, known)
    series = readings.series(len(solution.residual))
    said = verdict(solution, _suspects(readings, solution, standing, labels), series)
    turned = se3.log(mounting.rotation.T @ standing.rotation)
    found = [
        *(mounting.sign * solution.values[10:16]),
        *(standing.tilt if tilt else ()),
        *(turned if turn else ()),
        standing.late_s,
    ]
    nuisance = {name: (float(value), _unit(name)) for name, value in zip(labels[10:], found, strict=False)}
    unidentified = excitation_advice(solution, moving, arm, values, records.joints[records.loaded])
    return estimate_of(f"wrench, {'moving' if moving else 'static'}", solution, nuisance, unidentified, said, reading)


def _readings(arm: SerialArm, values: Array, records: PayloadSamples, mounting: Mounting, band_hz: float) -> _Readings:
    loaded, unloaded = records.run(True), records.run(False)
    assert loaded.wrench is not None and unloaded.wrench is not None
    raw, still = mounting.sign * loaded.wrench, mounting.sign * unloaded.wrench
    if loaded.time_s is None:
        zero = np.zeros_like(loaded.joints)
        regressors = _regressors(hand_motion(arm, values, loaded.joints, zero, zero))
        return _Readings(None, raw, still, *(np.array([part, 0 * part, 0 * part]) for part in regressors))
    band = band_of(loaded.time_s, band_hz)
    regressors = _regressors(hand_motion(arm, values, *band.motion(loaded.joints)))
    if len(unloaded) and unloaded.time_s is not None:
        same_step(band, unloaded)
        still = band_of(unloaded.time_s, band_hz).kept(still)
    parts = (np.array([band.kept(part, order=order) for order in range(3)]) for part in regressors)
    return _Readings(band, band.trimmed(raw), still, *parts)


def _regressors(motion: HandMotion) -> tuple[Array, Array]:
    """The regressor without gravity ``(n, 6, 10)``, and what each of gravity's components adds ``(n, 6, 10, 3)``."""
    zero = np.zeros_like(motion.omega)
    hanging = replace(motion, omega=zero, alpha=zero, acceleration=zero)
    return wrench_regressor(motion, np.zeros(3)), np.stack([wrench_regressor(hanging, axis) for axis in np.eye(3)], -1)


def _fitted(
    readings: _Readings, labels: Sequence[str], mounting: Mounting, sigma: Array | None
) -> tuple[ChannelSolution, _MountingEstimate]:
    """Gauss-Newton in how arm and sensor stand; the rest is linear."""
    standing = _MountingEstimate(mounting.gravity, mounting.rotation, np.zeros(2))
    linear = labels[:16]
    seen = np.concatenate([readings.seen(0.0), readings.still])
    solution = least_squares(linear, _columns(readings, standing), seen, _FORCE_AND_MOMENT, sigma)
    for _ in range(_ROUNDS if len(labels) > len(linear) else 0):
        freed = _freed(readings, standing, solution.values[:10])
        design = np.concatenate([_columns(readings, standing), *(freed[name] for name in labels[16:])], axis=2)
        seen = np.concatenate([readings.seen(standing.late_s), readings.still])
        solution = least_squares(labels, design, seen, _FORCE_AND_MOMENT, sigma)
        standing = _stepped(standing, dict(zip(labels, solution.values, strict=True)))
        if np.abs(solution.values[16:]).max() < _SETTLED:
            return solution, standing
    if len(labels) > len(linear) and np.abs(solution.values[16:]).max() > 1e-6:
        raise LabError("tilt, mounting or delay do not converge: align arm, sensor and clock better, or free fewer")
    return solution, standing


def _loaded(readings: _Readings, standing: _MountingEstimate, order: int = 0) -> Array:
    """The load's columns ``(k, 6, 10)`` in the sensor's axes."""
    return _turned(standing, readings.at_rest[order] + readings.by_gravity[order] @ standing.gravity)


def _columns(readings: _Readings, standing: _MountingEstimate) -> Array:
    """Of the load and the offsets, ``(k + m, 6, 16)``."""
    columns = _padded(readings, _loaded(readings, standing))
    return np.concatenate([columns, np.broadcast_to(np.eye(6), (len(columns), 6, 6))], axis=2)


def _freed(readings: _Readings, standing: _MountingEstimate, phi: Array) -> dict[str, Array]:
    """By name, one column ``(k + m, 6, 1)`` of what is fitted by steps, at a load ``phi``.

    Frame 0 tilted by d turns gravity in it by -d, and a sensor turned by d reads w - d x w.
    """
    wrench = _loaded(readings, standing) @ phi
    found = {}
    for name, axis in zip(_TILT, _horizontal(standing.gravity), strict=True):
        found[name] = _turned(standing, readings.by_gravity[0] @ np.cross(standing.gravity, axis)) @ phi
    for name, axis in zip(_TURN, np.eye(3), strict=True):
        found[name] = np.cross(wrench.reshape(-1, 2, 3), axis).reshape(-1, 6)
    found["delay"] = -_loaded(readings, standing, 1) @ phi
    return {name: _padded(readings, column[..., None]) for name, column in found.items()}


def _stepped(standing: _MountingEstimate, steps: dict[str, float]) -> _MountingEstimate:
    tilt = np.array([steps.get(name, 0.0) for name in _TILT])
    turn = np.array([steps.get(name, 0.0) for name in _TURN])
    return _MountingEstimate(
        se3.exp(-tilt @ _horizontal(standing.gravity)) @ standing.gravity,
        standing.rotation @ se3.exp(turn),
        standing.tilt + tilt,
        standing.late_s + float(steps.get("delay", 0.0)),
    )


def _suspects(
    readings: _Readings, solution: ChannelSolution, standing: _MountingEstimate, labels: Sequence[str]
) -> list[BiasCandidate]:
    phi = solution.values[:10]
    freed = _freed(readings, standing, phi)
    named = {
        _TILT: "a base that is tilted; estimate it (tilt)",
        _TURN: "a sensor that is turned; estimate it (turn)",
        ("delay",): "a delay between wrench and positions; estimate it (delay)",
    }
    found = [
        BiasCandidate(np.concatenate([freed[name] for name in names], axis=2), words)
        for names, words in named.items()
        if names[0] not in labels
    ]
    wrench = _padded(readings, (_loaded(readings, standing) @ phi)[:, :, None] * np.eye(6))
    found.append(BiasCandidate(wrench, "gains of the sensor's axes; calibrate the sensor"))
    bent = _loaded(readings, standing, 2) @ phi
    found.append(BiasCandidate(_padded(readings, bent[..., None]), "a filter that the wrench came through"))
    return found


def _unit(name: str) -> str:
    return next(unit for start, unit in _UNITS.items() if name.startswith(start))


def _horizontal(gravity: Array) -> NDArray[np.float64]:
    """Frame 0's x, or its y where x is upright, made horizontal, and what is horizontal across it: rows ``(2, 3)``."""
    up = -gravity / np.linalg.norm(gravity)
    x = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    x = x - (x @ up) * up
    x = x / np.linalg.norm(x)
    return np.array([x, np.cross(up, x)])


def _turned(standing: _MountingEstimate, columns: Array) -> Array:
    """Forces and moments ``(k, 6, ...)`` from the last frame's axes to the sensor's."""
    halves = columns.reshape(len(columns), 2, 3, -1)
    turned: Array = np.einsum("ji,nhjc->nhic", standing.rotation, halves)
    return turned.reshape(columns.shape)


def _padded(readings: _Readings, columns: Array) -> Array:
    """With rows of zeros for the unloaded run, in which nothing hangs from the sensor."""
    return np.concatenate([columns, np.zeros((len(readings.still), *columns.shape[1:]))])
