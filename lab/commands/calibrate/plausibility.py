"""Whether measurements are what they are taken for: rows that are copies, and a noise in another unit."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.calibration.identify import Identification
from lab.core.errors import LabError
from lab.core.measurements import Measurements

__all__ = ["refuse_noise_beyond", "refuse_noise_in_another_unit", "without_copies"]

LEAST_RESIDUAL_M = 1e-7  # below, residuals are rounding, and say nothing of the noise
LEAST_FREEDOM = 10
LEAST_ROWS = 5  # of fewer the fit says what they lack
UNIT = 100.0  # times the residuals' noise that a given one may be: a unit is a thousand
ANOTHER_DAY = 500.0  # the same of an instrument that may be another one


def without_copies(path: Path, data: Measurements) -> Measurements:
    """The rows that do not repeat an earlier one to the last digit, with a warning of the others.

    Nothing is measured twice alike: a copy would count as a measurement of its own, and make intervals too narrow.
    """
    conditions = [column for _, column in sorted(data.conditions.items())]
    names = {name: float(i) for i, name in enumerate(dict.fromkeys(data.sessions))}
    numbers = np.column_stack(
        [data.joints, data.points.reshape(len(data), -1), *conditions, [names[name] for name in data.sessions]]
    )
    seen = np.flatnonzero(data.seen.any(axis=1))
    alike = np.ascontiguousarray(numbers[seen]).view(np.dtype((np.void, numbers.itemsize * numbers.shape[1]))).ravel()
    _, first, group = np.unique(alike, return_index=True, return_inverse=True)
    earlier = seen[first[group]]
    copies = [(int(row), int(earlier[i])) for i, row in enumerate(seen) if earlier[i] != row]
    if not copies or len(data) - len(copies) < LEAST_ROWS:
        return data
    row, same = copies[0]
    count = "1 row is a copy" if len(copies) == 1 else f"{len(copies)} rows are copies"
    said = (
        f"{path}: {count} of an earlier one to the last digit (the first: {data.where(row)}, of {data.where(same)}), "
        "which measurements never are: left out"
    )
    gone = {row for row, _ in copies}
    kept = data.take([row for row in range(len(data)) if row not in gone])
    return replace(kept, warnings=(*kept.warnings, said))


def refuse_noise_in_another_unit(noise_mm: float | None, rows: Measurements, found: Identification) -> None:
    """Refuse a noise that is far more than the residuals of the fit.

    Args:
        noise_mm: the option; None where it was not given.
        rows: that were fitted.

    Raises:
        LabError: it is; with the number that it would be in the right unit.
    """
    if found.dof >= LEAST_FREEDOM:
        refuse_noise_beyond(noise_mm, rows, found.residual_sigma_m, "the residuals", UNIT)


def refuse_noise_beyond(
    noise_mm: float | None, rows: Measurements, known_m: float, whose: str, times: float = ANOTHER_DAY
) -> None:
    """Refuse a noise that is far more than what is known of the robot and its instrument.

    Args:
        noise_mm: the option; None where it was not given, and the rows say it.
        rows: that it is of.
        known_m: standard deviation per axis of residuals with such an instrument.
        whose: the residuals' name in the message.
        times: how many times as much it may be.

    Raises:
        LabError: it is; with the number that it would be in the right unit.
    """
    name, given_mm = "--noise-mm", noise_mm
    if given_mm is None:
        name, known = "column sigma_mm", rows.sigma_m[np.isfinite(rows.sigma_m)]
        given_mm = 1e3 * float(np.median(known)) if known.size else None
    if given_mm is not None and known_m > LEAST_RESIDUAL_M and given_mm / 1e3 > times * known_m:
        raise LabError(
            f"{name} {given_mm:g}: {whose} are those of a noise of {1e3 * known_m:.2g} mm, "
            f"{given_mm / 1e3 / known_m:.0f} times less; is it in µm? That would be {given_mm / 1e3:g} mm"
        )
