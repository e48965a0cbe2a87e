"""What a budget predicts for a validation, against good virtual campaigns: no more is observed, and no less."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.certification.budget import Propagation, quantities_of
from lab.certification.lack_of_fit import lack_of_fit
from lab.core.measurements import Measurements
from lab.formats.measurement_csv import write_measurements
from lab.library.certificate_inputs import fitted_rows, instrument_noise_m, random_errors, validation_errors
from lab.library.certify import _propagation
from lab.library.load_run import load_run
from lab.noise.instruments import TrackerErrors

INSTRUMENT = "uniform-8um"


def compared(folder: Path, rows: Measurements, **options: object) -> tuple[float, float]:
    """Root mean square errors of a run's validation, observed and as its budget predicts them (m)."""
    result = lab.identify(rows, robot="irb120", instrument=INSTRUMENT, **options)
    folder.mkdir()
    result.write(folder)
    calibrated = load_run(folder, accept_edited=True)
    fitted = fitted_rows(calibrated)
    found: Propagation = _propagation(calibrated, fitted)
    chance = random_errors(calibrated, fitted, fitted.instrument, None, None)
    noise_m = instrument_noise_m(calibrated, fitted, fitted.instrument)
    quantities = quantities_of(found, TrackerErrors(), INSTRUMENT, chance)
    errors = validation_errors(calibrated, fitted, found, quantities, chance, noise_m)
    assert errors is not None
    known = lack_of_fit(errors)
    return known.observed_rms_m, known.expected_rms_m


def campaigns(count: int, poses: int) -> Sequence[Measurements]:
    return [lab.simulate("irb120", poses=poses, seed=i, instrument=INSTRUMENT).measurements for i in range(count)]


def ratio(pairs: Sequence[tuple[float, float]]) -> float:
    """Of the pooled mean squares."""
    return float(np.mean([seen**2 for seen, _ in pairs]) / np.mean([expected**2 for _, expected in pairs]))


@pytest.mark.thorough
def test_held_out_rows_have_the_errors_that_are_predicted(tmp_path: Path) -> None:
    """Four times 12 poses, 144 numbers: one sigma of their mean square is 12 %."""
    rows = campaigns(4, 40)
    pairs = [compared(tmp_path / str(i), each, holdout=0.3, seed=i) for i, each in enumerate(rows)]
    assert ratio(pairs) == pytest.approx(1.0, abs=0.36)


@pytest.mark.thorough
def test_folds_have_the_errors_that_their_leverage_predicts(tmp_path: Path) -> None:
    """30 poses for 27 parameters: prediction by the others makes errors 1.5 times the noise's, or more."""
    pairs = [compared(tmp_path / str(i), each) for i, each in enumerate(campaigns(4, 30))]
    assert ratio(pairs) == pytest.approx(1.0, abs=0.36)
    assert all(expected > 1.15 * np.sqrt(3) * 8e-6 / np.sqrt(3) for _, expected in pairs)


@pytest.mark.thorough
def test_a_file_whose_base_is_placed_anew_shows_no_error_of_the_base(tmp_path: Path) -> None:
    day = lab.simulate("irb120", poses=80, seed=3, instrument=INSTRUMENT).measurements
    later = day[np.arange(40, 80)]
    elsewhere = replace(later, points=later.points + np.array([0.1, 0.2, -0.1]))
    pairs = []
    for name, rows in (("here", later), ("elsewhere", elsewhere)):
        path = tmp_path / f"{name}.csv"
        write_measurements(path, rows, (False,) * 6)
        options = {"refit": ("base",)} if name == "elsewhere" else {}
        pairs.append(compared(tmp_path / name, day[:40], validate=path, **options))
    assert pairs[1][1] < pairs[0][1]
    for seen, expected in pairs:
        assert seen == pytest.approx(expected, rel=0.3)
