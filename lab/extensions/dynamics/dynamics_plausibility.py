"""Check whether recordings, payloads and arm dynamics are plausible, and name likely mistakes.

Least squares fits any data: torques in another unit give links of tons whose residuals are noise. So masses, lengths
and gravity torques are compared with those of the nominal arm, and drives with its weight.

Rows may be shifted against each other. The torques of a payload and of an arm's links are functions of the joint
positions: of the upward direction in the last frame, and of cosines and sines of joint positions and of their sums.
With an orthonormal basis of these, the share of the measurements that the positions of s rows later explain is a sum of
squared cross-correlations at the lag s, for all lags at once by Fourier transforms (Oppenheim & Schafer 2010, section
8.7). It is highest where rows belong together.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.checks import Check
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import UNSOLICITED_WARNING
from lab.core.units import MM
from lab.extensions.dynamics.arm.base_parameters import random_states
from lab.extensions.dynamics.arm.identify_dynamics import DynamicModel, DynamicsEstimate, PhysicalFit
from lab.extensions.dynamics.load_files import PayloadSamples
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.serial.chain import COLUMNS, Chain

__all__ = [
    "ArmSize",
    "implausibilities",
    "implausible_dynamics",
    "misplaced_points",
    "not_of_the_arm",
    "stuck_channels",
]

_Upward = Callable[[Array], Array]  # joint positions (n, joints) to (n, 3): the upward direction in the last frame
_Fit = Callable[[PayloadSamples], LoadEstimate]

_MAX_SHIFT = 0.25  # of a run's rows
_ROWS_PER_FUNCTION = 4  # rows of a run for each function of the joint positions
_MIN_SINGULAR_VALUE = 1e-6  # of the largest: below, a function depends on the others
_MAX_OF_ARM = 1.5  # times its own mass that an arm carries: the strongest carry half of it
_MAX_KG = 1000.0  # where the arm's mass is not known
_KGF_N = 9.80665  # of a kilogram's weight
_MIN_DISTANCE_M = 0.001  # of a centre of mass that a unit would make plausible: hands have a length
_BAD_FIT = 0.3  # residual share of what was to be explained
_FAR_BETTER = 0.5  # times the residual share
_NEAR_SHIFTS = (1, -1, 2, -2)  # rows, which are tried in any case
_FAR_SHIFTS = 8  # that a cross-correlation finds likeliest
_FAR_M = 0.03  # root mean square of points from where the arm has them: no arm sags so far
_BEARS = 0.2  # of the largest torque of the arm's own weight: of less, friction may hide it
_EXCHANGED = 0.03  # more correlated with another drive's weight: the columns are exchanged
_MIN_CORRELATION = 0.5  # of a drive's torque with that of nominal masses
_MIN_STUCK_ROWS = 5  # of one and the same reading that no noise makes
_MAX_AT_END = 0.05  # of the rows of a run that may have its largest, or its smallest, reading
_MIN_READINGS = 20  # different ones, of a channel that is not rounded coarsely
_STATES = 200
_OTHER_UNIT = 30.0  # times the gravity torques of the nominal masses: no arm of its kind
_WEAK = 5.0  # times less than the nominal masses need along random states
_STRONG = 10.0  # times the largest torque that they need: no friction and no motor adds so much
_UNEXPLAINED = 0.5  # of what torques change by
_CONSTANT = 1e-9  # of their size: torques that change by less are constant
_MIN_GRAVITY = 1e-6  # Nm or N: less is none


@dataclass(frozen=True)
class ArmSize:
    """Size of an arm, which bounds its plausible payloads.

    Attributes:
        reach_m: from the base to the flange, stretched out.
        mass_kg: of its links; NaN where unknown.
    """

    reach_m: float
    mass_kg: float

    @classmethod
    def of(cls, chain: Chain, loads: Loads | None) -> "ArmSize":
        """Compute the size of an arm from its table and the masses of its links, if given."""
        lengths = np.abs(chain.table[:, [COLUMNS.index("d"), COLUMNS.index("a")]]).sum()
        slides = np.where(chain.prismatic, np.maximum(np.abs(chain.lower), np.abs(chain.upper)), 0.0).sum()
        return cls(float(lengths + slides), np.nan if loads is None else float(loads.mass_kg.sum()))


def _implausible(name: str, **data: Any) -> Check:
    return Check(name, "failed", data=data)


def stuck_channels(samples: PayloadSamples, names: Sequence[str], shows: NDArray[np.bool_]) -> tuple[Check, ...]:
    """Return the channels of torques or of a wrench that are constant in a run, or stay at one end of it.

    Args:
        samples: with ``names`` for the channels of the wrench, or of the torques where there is none.
        shows: ``(d,)`` which channels have to change, by a model.
    """
    readings = samples.torques if samples.wrench is None else samples.wrench
    assert readings is not None
    found = []
    for loaded, run in ((True, "loaded"), (False, "unloaded")):
        rows = readings[samples.loaded == loaded]
        if len(rows) < _MIN_STUCK_ROWS:
            continue
        for name, channel in zip(np.array(names)[shows].tolist(), rows.T[shows], strict=True):
            where = {"channel": name, "rows": len(rows), "run": run}
            if channel.min() == channel.max():
                found.append(_implausible("channel.constant", value=channel[0], **where))
            elif len(np.unique(channel)) >= _MIN_READINGS:
                count = max(int((channel == end).sum()) for end in (channel.min(), channel.max()))
                if count > max(_MAX_AT_END * len(rows), _MIN_STUCK_ROWS):
                    found.append(_implausible("channel.saturated", count=count, **where))
    return tuple(found)


def not_of_the_arm(measured: Array, expected: Array, names: Sequence[str]) -> tuple[Check, ...]:
    """Return the drives whose torques at rest do not follow the arm's own weight, whatever their scale and offset.

    Args:
        measured: ``(n, J)`` torques without a load, at rest.
        expected: ``(n, J)`` by the nominal masses.
    """
    if len(measured) < _MIN_STUCK_ROWS:
        return ()
    seen, weight = measured - measured.mean(axis=0), expected - expected.mean(axis=0)
    size = np.sqrt((weight**2).mean(axis=0))
    bears = [int(drive) for drive in np.flatnonzero(size >= _BEARS * size.max())]
    lengths = np.linalg.norm(seen, axis=0)[bears, None] * np.linalg.norm(weight, axis=0)[bears]
    correlations = seen[:, bears].T @ weight[:, bears] / np.maximum(lengths, 1e-300)
    found = []
    for i, (drive, row) in enumerate(zip(bears, correlations, strict=True)):
        other = int(row.argmax())
        if row[i] < _MIN_CORRELATION or row[other] > row[i] + _EXCHANGED:
            likest = {"other": names[bears[other]], "other_correlation": row[other]}
            found.append(_implausible("channel.unlike_weight", drive=names[drive], correlation=row[i], **likest))
    return tuple(found)


def misplaced_points(predicted: Array, *measured: Array) -> tuple[Check, ...]:
    """Return the distance of points of a soft arm from where it is, where that is large: a wrong frame, axes or unit.

    Args:
        predicted: ``(n, k, 3)`` m, without the sag.
        measured: ``(n, k, 3)`` m each, without and with a load; NaN where not seen.
    """
    apart = max(float(np.sqrt(np.nanmean(((each - predicted) ** 2).sum(axis=2)))) for each in measured)
    return (_implausible("points.elsewhere", distance_m=apart),) if apart > _FAR_M else ()


def implausibilities(
    found: LoadEstimate,
    arm: ArmSize,
    samples: PayloadSamples | None = None,
    fit: _Fit | None = None,
    upward: _Upward | None = None,
) -> tuple[Check, ...]:
    """Return the reasons why a payload is implausible, or better explained by a mistake in the file.

    Args:
        arm: that carries it.
        samples: from which it was identified.
        fit: identifies it from others; a LabError where it cannot.
        upward: the upward direction in the last frame, for shifts by more than two rows.
    """
    reasons = [*_check_mass(found, arm), *_check_centre(found, arm)]
    if samples is not None and fit is not None and (reasons or _residual_share(found) > _BAD_FIT):
        reasons += _better_reading(found, arm, samples, fit, upward)
    return tuple(reasons)


def _check_mass(found: LoadEstimate, arm: ArmSize) -> Iterator[Check]:
    mass, width = found.mass_kg, found.mass_half_width_kg
    if not np.isfinite(mass):
        return
    most = _MAX_OF_ARM * arm.mass_kg if np.isfinite(arm.mass_kg) else _MAX_KG
    if mass > most:
        unit = "Nmm or mN" if mass / 1e3 <= most else "another unit"
        yield _implausible("mass.large", kg=mass, most_kg=most, unit=unit)
    elif mass + width < 0:
        yield _implausible("mass.negative", kg=mass)
    elif not mass > width:
        yield _implausible("mass.uncertain", kg=mass, half_width_kg=width)


def _check_centre(found: LoadEstimate, arm: ArmSize) -> Iterator[Check]:
    centre = found.com_m
    distance = float(np.linalg.norm(centre))
    if not np.isfinite(distance) or distance <= arm.reach_m or not found.mass_kg > found.mass_half_width_kg:
        return
    nearest = float(np.linalg.norm(np.maximum(np.abs(centre) - found.com_half_width, 0)))
    if nearest <= arm.reach_m and (found.com_half_width > arm.reach_m).any():
        return  # its interval is that wide
    scales = {"forces in kgf": _KGF_N, "moments in Nmm": 1e3, "forces in kgf and moments in Nmm": 1e3 * _KGF_N}
    units = [
        (unit, MM.of(distance) / scale)
        for unit, scale in scales.items()
        if _MIN_DISTANCE_M <= distance / scale <= arm.reach_m
    ]
    yield _implausible("centre.far", distance_m=distance, reach_m=arm.reach_m, units=units)


def _residual_share(found: LoadEstimate) -> float:
    """Return the residual share of the measurements' variation about each channel's mean."""
    spread = found.measured - found.measured.mean(axis=0)
    size = float(np.sqrt((spread**2).sum()))
    return float(np.sqrt((found.residual**2).sum())) / size if size else 0.0


def _better_reading(
    found: LoadEstimate, arm: ArmSize, samples: PayloadSamples, fit: _Fit, upward: _Upward | None
) -> Iterator[Check]:
    """Find a reading of the file for which a payload fits far better and is plausible."""
    here = _residual_share(found)
    for name, data, other in _readings(samples, upward):
        try:
            again = fit(other)
        except (LabError, np.linalg.LinAlgError):
            continue
        left = _residual_share(again)
        if left < _FAR_BETTER * here and not [*_check_mass(again, arm), *_check_centre(again, arm)]:
            yield _implausible(f"otherwise.{name}", left=left, left_here=here, kg=again.mass_kg, **data)
            return


def _readings(
    samples: PayloadSamples, upward: _Upward | None
) -> Iterator[tuple[str, Mapping[str, Any], PayloadSamples]]:
    """Yield alternative readings of a file."""
    far = () if upward is None else _likely_shifts(samples, upward, _FAR_SHIFTS)
    for rows in dict.fromkeys((*_NEAR_SHIFTS, *far)):
        shifted = _shifted(samples, rows)
        if shifted is not None:
            yield "shifted", {"rows": rows}, shifted
    if samples.loaded.all() and len(samples) > 1:
        first = np.arange(len(samples)) < len(samples) // 2
        yield "half", {"half": "first"}, replace(samples, loaded=first)
        yield "half", {"half": "second"}, replace(samples, loaded=~first)
    yield "radians", {}, replace(samples, joints=samples.joints / (np.pi / 180))
    yield "degrees", {}, replace(samples, joints=samples.joints * (np.pi / 180))


def _shifted(samples: PayloadSamples, rows: int) -> PayloadSamples | None:
    """Return samples whose joint positions are taken later by some rows in each run; None where a run is too short."""
    parts = []
    for loaded in (True, False):
        run = np.flatnonzero(samples.loaded == loaded)
        if len(run) == 0:
            continue
        if len(run) <= 2 * abs(rows):
            return None
        measured, positions = (run[:-rows], run[rows:]) if rows > 0 else (run[-rows:], run[:rows])
        parts.append((measured, positions))
    measured, positions = (np.concatenate(each) for each in zip(*parts, strict=True))
    joints: Array = samples.joints[positions]
    return replace(samples.take(measured), joints=joints)


def _likely_shifts(samples: PayloadSamples, upward: _Upward, count: int) -> tuple[int, ...]:
    """Find row shifts by which joint positions may lag the measurements; the likeliest first, without zero."""
    runs = [run for loaded in (True, False) if len(run := samples.run(loaded)) >= 2 * _ROWS_PER_FUNCTION]
    if not runs:
        return ()
    most = int(_MAX_SHIFT * min(map(len, runs)))
    lags = np.concatenate([np.arange(-most, 0), np.arange(1, most + 1)])
    shares = np.sum([_shares(run, upward)[lags] for run in runs], axis=0)
    return tuple(int(lags[i]) for i in np.argsort(-shares, kind="stable")[:count])


def _shares(run: PayloadSamples, upward: _Upward) -> Array:
    """Return the share ``(2 n,)`` of the measurements that the positions of so many rows later explain.

    Those counted from the end are earlier. Each channel has the same weight.
    """
    given = [each for each in (run.torques, run.wrench) if each is not None]
    channels = np.concatenate(given, axis=1)
    channels = channels - channels.mean(axis=0)
    sizes = np.linalg.norm(channels, axis=0)
    channels = channels[:, sizes > 0] / sizes[sizes > 0]
    basis, n = _basis(run.joints, upward), len(run)
    turned = np.fft.rfft(basis, 2 * n, axis=0)[:, :, None] * np.fft.rfft(channels, 2 * n, axis=0).conj()[:, None]
    together = np.fft.irfft(turned, 2 * n, axis=0)
    lag = np.minimum(np.arange(2 * n), np.arange(2 * n, 0, -1))
    return np.asarray((together**2).sum(axis=(1, 2)) * (n / np.maximum(n - lag, 1)))


def _basis(joints: Array, upward: _Upward) -> Array:
    """Return orthonormal functions ``(n, d)`` of joint positions, without their mean."""
    size = joints.shape[1]
    pairs = [joints[:, i] + sign * joints[:, i + 1] for i in range(size - 1) for sign in (1, -1)]
    angles = np.column_stack([joints, *pairs])
    functions = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(joints), -1)
    functions = np.column_stack([upward(joints), functions])[:, : max(len(joints) // _ROWS_PER_FUNCTION, 3)]
    u, sizes, _ = np.linalg.svd(functions - functions.mean(axis=0), full_matrices=False)
    return np.asarray(u[:, sizes > _MIN_SINGULAR_VALUE * sizes.max(initial=0.0)])


def implausible_dynamics(
    found: DynamicsEstimate, model: DynamicModel, arm: ArmSize, nominal: Array | None, nearest: PhysicalFit | None
) -> tuple[Check, ...]:
    """Return the reasons why identified parameters of an arm or of its load are implausible.

    Args:
        arm: bounds the load.
        nominal: ``(b,)`` base parameters by the links' nominal masses; None where these are not given.
        nearest: the nearest physically consistent parameters; None where not every base parameter was identified.
    """
    with np.errstate(all="ignore"):  # impossible values may overflow
        reasons = [*_check_fit(found)]
        if nominal is not None:
            reasons += [*_check_gravity(found, model, nominal), *_check_drives(found, model, nominal)]
        if nearest is not None and nearest.p < UNSOLICITED_WARNING:
            reasons.append(_implausible("arm.impossible", sigmas=nearest.distance, p=nearest.p))
        return (*reasons, *(() if found.load is None else implausibilities(found.load, arm)))


def _check_fit(found: DynamicsEstimate) -> Iterator[Check]:
    """Check that torques change, and follow the motion."""
    changes = float(np.sqrt(((found.measured - found.measured.mean(axis=0)) ** 2).sum()))
    left = float(np.sqrt((found.residual**2).sum()))
    if changes <= _CONSTANT * float(np.sqrt((found.measured**2).sum())):
        yield _implausible("torques.constant")
    elif left > _UNEXPLAINED * changes:
        yield _implausible("torques.unexplained", percent=100 * left / changes)


def _check_gravity(found: DynamicsEstimate, model: DynamicModel, nominal: Array) -> Iterator[Check]:
    """Compare the identified gravity torques with those of the nominal masses, unless these are negligible."""
    seen, expected = (
        _gravity(model, np.where(found.identified, each, 0.0)) for each in (np.nan_to_num(found.values), nominal)
    )
    if expected < _MIN_GRAVITY or 1 / _OTHER_UNIT < seen / expected < _OTHER_UNIT:
        return
    times = seen / expected
    yield _implausible("gravity.differs", times=times, in_nmm=1 / _OTHER_UNIT < times / 1e3 < _OTHER_UNIT)


def _gravity(model: DynamicModel, values: Array) -> float:
    """Return the root mean square of the drives' torques at rest about their means, which hold the offsets."""
    joints, _, _ = random_states(model.arm, _STATES, rng_for(0, "structure", 3))
    still = np.zeros_like(joints)
    torques = model.torques(values, (joints, still, still))
    return float(np.sqrt(((torques - torques.mean(axis=0)) ** 2).mean()))


def _check_drives(found: DynamicsEstimate, model: DynamicModel, nominal: Array) -> Iterator[Check]:
    """Find drives whose torques are far less than their links need, or far more than any link does."""
    if not found.identified.all():
        return
    states = random_states(model.arm, _STATES, rng_for(0, "structure", 3))
    seen, expected = (np.sqrt((model.torques(each, states) ** 2).mean(axis=0)) for each in (found.values, nominal))
    for name, some, least in zip(model.chain.joint_names, seen, expected, strict=True):
        if some < least / _WEAK and least > _MIN_GRAVITY:
            yield _implausible("drive.weak", drive=name, times=some / least)
        elif some > _STRONG * expected.max() > _MIN_GRAVITY:
            yield _implausible("drive.strong", drive=name, times=some / expected.max())
