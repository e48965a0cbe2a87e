"""Test what a file of loads gives: rows that belong together, points in their place, and a payload that can be.

What a payload and an arm's own links do is a function of where the joints are: of which way is up in the last frame,
and of cosines and sines of joint positions and of their sums. With an orthonormal basis of these, the share of what
was measured that the positions of s rows later explain is a sum of squared cross-correlations at the lag s, for all
lags at once by Fourier transforms (Oppenheim & Schafer 2010, section 8.7). It is highest where rows belong together.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError, counted
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.dynamics.load_files import PayloadSamples
from lab.extensions.dynamics.payload.estimate import LoadEstimate
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.serial.chain import COLUMNS, Chain

__all__ = [
    "ArmSize",
    "Implausibility",
    "Upward",
    "implausibilities",
    "misplaced_points",
    "not_of_the_arm",
    "stuck_channels",
]

Upward = Callable[[Array], Array]  # joint positions (n, joints) to (n, 3): which way is up in the last frame

_MOST = 0.25  # of a run's rows: the largest shift that is looked for
_ROWS_FOR_ONE = 4  # rows of a run for each function of the joint positions
_LEAST_SIZE = 1e-6  # of the largest singular value: less is a function of the others


def _likely_shifts(samples: PayloadSamples, upward: Upward, count: int) -> tuple[int, ...]:
    """Find row shifts by which joint positions may lag the measurements; the likeliest first, without zero."""
    runs = [run for loaded in (True, False) if len(run := samples.run(loaded)) >= 2 * _ROWS_FOR_ONE]
    if not runs:
        return ()
    most = int(_MOST * min(map(len, runs)))
    lags = np.concatenate([np.arange(-most, 0), np.arange(1, most + 1)])
    shares = np.sum([_shares(run, upward)[lags] for run in runs], axis=0)
    return tuple(int(lags[i]) for i in np.argsort(-shares, kind="stable")[:count])


def _shares(run: PayloadSamples, upward: Upward) -> Array:
    """``(2 n,)`` the share of what was measured that the positions of so many rows later explain.

    From the end they are earlier. Each channel counts alike.
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


def _basis(joints: Array, upward: Upward) -> Array:
    """Orthonormal functions ``(n, d)`` of joint positions, without their mean."""
    size = joints.shape[1]
    pairs = [joints[:, i] + sign * joints[:, i + 1] for i in range(size - 1) for sign in (1, -1)]
    angles = np.column_stack([joints, *pairs])
    functions = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(joints), -1)
    functions = np.column_stack([upward(joints), functions])[:, : max(len(joints) // _ROWS_FOR_ONE, 3)]
    u, sizes, _ = np.linalg.svd(functions - functions.mean(axis=0), full_matrices=False)
    return np.asarray(u[:, sizes > _LEAST_SIZE * sizes.max(initial=0.0)])


_MOST_OF_ARM = 1.5  # times its own mass that an arm carries: the strongest carry half of it
_MOST_KG = 1000.0  # where the arm's mass is not known
_KGF_N = 9.80665  # of a kilogram's weight
_LEAST_DISTANCE_M = 0.001  # of a centre of mass that a unit would make plausible: hands have a length
_FITS_BADLY = 0.3  # of what was to be explained that is left
_FAR_BETTER = 0.5  # times as much left
NEAR_SHIFTS = (1, -1, 2, -2)  # rows, which are tried in any case
_FAR_SHIFTS = 8  # that a cross-correlation finds likeliest
FAR_M = 0.03  # root mean square of points from where the arm has them: no arm sags so far
BEARS = 0.2  # of the largest torque of the arm's own weight: of less, friction may hide it
_ANOTHER = 0.03  # more alike to another drive's weight: the columns are exchanged
ALIKE = 0.5  # correlation of a drive's torque with that of nominal masses, at least
_LEAST_STUCK = 5  # rows of one and the same reading that no noise makes
_MOST_AT_END = 0.05  # of the rows of a run that may have its largest, or its smallest, reading
_LEAST_READINGS = 20  # different ones, of a channel that is not rounded coarsely
_DEGREE = np.pi / 180

Fit = Callable[[PayloadSamples], LoadEstimate]


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


@dataclass(frozen=True)
class Implausibility:
    """A reason why a payload is implausible, with a remedy if one was found."""

    description: str


def stuck_channels(
    samples: PayloadSamples, names: Sequence[str], shows: NDArray[np.bool_]
) -> tuple[Implausibility, ...]:
    """Channels of torques or of a wrench that are constant in a run, or stay at one end of it.

    Args:
        samples: with ``names`` for the channels of the wrench, or of the torques where there is none.
        shows: ``(d,)`` which channels have to change, by a model.
    """
    readings = samples.torques if samples.wrench is None else samples.wrench
    assert readings is not None
    messages = []
    for loaded, run in ((True, "loaded"), (False, "unloaded")):
        rows = readings[samples.loaded == loaded]
        if len(rows) < _LEAST_STUCK:
            continue
        for name, channel in zip(np.array(names)[shows], rows.T[shows], strict=True):
            if channel.min() == channel.max():
                text = f"{name} is {channel[0]:.4g} in all {len(rows)} rows of the {run} run"
                messages.append(f"{text}: is its sensor connected, and is the column the right one?")
            elif len(np.unique(channel)) >= _LEAST_READINGS:
                count = max(int((channel == end).sum()) for end in (channel.min(), channel.max()))
                if count > max(_MOST_AT_END * len(rows), _LEAST_STUCK):
                    text = f"{name} stays at the end of its range in {count} of the {len(rows)} rows of the {run} run"
                    messages.append(f"{text}: it saturates; move more slowly, or with a smaller load")
    return tuple(Implausibility(text) for text in dict.fromkeys(messages))


def not_of_the_arm(measured: Array, expected: Array, names: Sequence[str]) -> tuple[Implausibility, ...]:
    """Drives whose torques at rest do not follow the arm's own weight, whatever their scale and offset.

    Args:
        measured: ``(n, J)`` torques without a load, at rest.
        expected: ``(n, J)`` by the nominal masses.
    """
    if len(measured) < _LEAST_STUCK:
        return ()
    seen, weight = measured - measured.mean(axis=0), expected - expected.mean(axis=0)
    size = np.sqrt((weight**2).mean(axis=0))
    bears = [int(drive) for drive in np.flatnonzero(size >= BEARS * size.max())]
    lengths = np.linalg.norm(seen, axis=0)[bears, None] * np.linalg.norm(weight, axis=0)[bears]
    alike, messages = seen[:, bears].T @ weight[:, bears] / np.maximum(lengths, 1e-300), []
    for row, drive in enumerate(bears):
        other = int(alike[row].argmax())
        if alike[row, row] < ALIKE or alike[row, other] > alike[row, row] + _ANOTHER:
            like = "" if other == row else f", and that of {names[bears[other]]} is {alike[row, other]:.2g}"
            messages.append(
                f"without a load, the torque of {names[drive]} does not follow the arm's own weight (correlation "
                f"{alike[row, row]:.2g}{like}): are signs and order of the torques right, and the joint positions?"
            )
    return tuple(Implausibility(text) for text in messages)


def misplaced_points(predicted: Array, *measured: Array) -> tuple[Implausibility, ...]:
    """Points of a soft arm that are not where it is: another frame, other axes or another unit.

    Args:
        predicted: ``(n, k, 3)`` m, without the sag.
        measured: ``(n, k, 3)`` m each, without and with a load; NaN where not seen.
    """
    apart = max(float(np.sqrt(np.nanmean(((each - predicted) ** 2).sum(axis=2)))) for each in measured)
    if not apart > FAR_M:
        return ()
    return (
        Implausibility(
            f"the points are {MM.text(apart)} from where the calibrated arm has them: are they in the frame, the "
            "axes and the unit of the run? Measure from the same base frame, or calibrate again"
        ),
    )


def implausibilities(
    found: LoadEstimate,
    arm: ArmSize,
    samples: PayloadSamples | None = None,
    fit: Fit | None = None,
    upward: Upward | None = None,
) -> tuple[Implausibility, ...]:
    """Return the reasons why a payload is implausible, or better explained by a mistake in the file.

    Args:
        arm: that carries it.
        samples: from which it was identified.
        fit: identifies it from others; a LabError where it cannot.
        upward: the way up in the last frame, for shifts by more than two rows.
    """
    messages = [*_of_mass(found, arm), *_of_centre(found, arm)]
    if samples is not None and fit is not None and (messages or _left(found) > _FITS_BADLY):
        messages += _otherwise(found, arm, samples, fit, upward)
    return tuple(Implausibility(text) for text in messages)


def _of_mass(found: LoadEstimate, arm: ArmSize) -> Iterator[str]:
    mass, width = found.mass_kg, found.mass_half_width_kg
    if not np.isfinite(mass):
        return
    most = _MOST_OF_ARM * arm.mass_kg if np.isfinite(arm.mass_kg) else _MOST_KG
    if mass > most:
        unit = "Nmm or mN" if mass / 1e3 <= most else "another unit"
        yield (
            f"{mass:.4g} kg are more than an arm of its size carries ({most:.3g} kg): are torques or forces in {unit}?"
        )
    elif mass + width < 0:
        yield f"the payload would weigh {mass:.3g} kg: are loaded and unloaded rows exchanged?"
    elif not mass > width:
        yield (
            f"the mass is {mass:.2g} ± {width:.2g} kg, which no load at all explains as well: was one carried, and are "
            "loaded and unloaded rows marked as they were?"
        )


def _of_centre(found: LoadEstimate, arm: ArmSize) -> Iterator[str]:
    centre = found.com_m
    distance = float(np.linalg.norm(centre))
    if not np.isfinite(distance) or distance <= arm.reach_m or not found.mass_kg > found.mass_half_width_kg:
        return
    nearest = float(np.linalg.norm(np.maximum(np.abs(centre) - found.com_half_width, 0)))
    if nearest <= arm.reach_m and (found.com_half_width > arm.reach_m).any():
        return  # it is not known, and its interval says so
    units = [
        f"{unit} (it would be {MM.of(distance) / larger:.3g} mm away)"
        for unit, larger in (
            ("forces in kgf", _KGF_N),
            ("moments in Nmm", 1e3),
            ("forces in kgf and moments in Nmm", 1e3 * _KGF_N),
        )
        if _LEAST_DISTANCE_M <= distance / larger <= arm.reach_m
    ]
    yield (
        f"the centre of mass is {distance:.3g} m from the flange, farther than the arm reaches ({arm.reach_m:.2g} m): "
        f"are {', or '.join(units) or 'moments in another unit'}?"
    )


def _left(found: LoadEstimate) -> float:
    """Return the residual share of the measurements' variation about each channel's mean."""
    spread = found.measured - found.measured.mean(axis=0)
    size = float(np.sqrt((spread**2).sum()))
    return float(np.sqrt((found.residual**2).sum())) / size if size else 0.0


def _otherwise(
    found: LoadEstimate, arm: ArmSize, samples: PayloadSamples, fit: Fit, upward: Upward | None
) -> Iterator[str]:
    """Find interpretations of the file for which a payload fits far better and is plausible."""
    here = _left(found)
    for reading, other in _readings(samples, upward):
        try:
            again = fit(other)
        except (LabError, np.linalg.LinAlgError):
            continue
        if _left(again) < _FAR_BETTER * here and not [*_of_mass(again, arm), *_of_centre(again, arm)]:
            yield (
                f"{reading}: {100 * _left(again):.2g} % of what was measured is then left unexplained, and "
                f"{100 * here:.2g} % is as the file stands (the payload would be {again.mass_kg:.3g} kg)"
            )
            return


def _readings(samples: PayloadSamples, upward: Upward | None) -> Iterator[tuple[str, PayloadSamples]]:
    """Yield alternative interpretations of a file."""
    far = () if upward is None else _likely_shifts(samples, upward, _FAR_SHIFTS)
    for rows in dict.fromkeys((*NEAR_SHIFTS, *far)):
        shifted = _shifted(samples, rows)
        if shifted is not None:
            side = "later" if rows > 0 else "earlier"
            count = counted(abs(rows), "row")
            yield f"the joint positions seem to be {count} {side} than what was measured there", shifted
    if samples.loaded.all() and len(samples) > 1:
        first = np.arange(len(samples)) < len(samples) // 2
        for half, loaded in (("first", first), ("second", ~first)):
            yield (
                f"every row is marked as loaded, but only the {half} half seems to be",
                replace(samples, loaded=loaded),
            )
    yield (
        "the joint positions seem to be radians in columns of degrees",
        replace(samples, joints=samples.joints / _DEGREE),
    )
    yield (
        "the joint positions seem to be degrees in columns of radians",
        replace(samples, joints=samples.joints * _DEGREE),
    )


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
