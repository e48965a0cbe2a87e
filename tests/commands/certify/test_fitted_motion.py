"""A drift and sessions that a run fitted are in the budget of its certificate, by their size at the end."""

from pathlib import Path

import numpy as np
import pytest

import lab
from lab.library.certificate_inputs import fitted_motions, fitted_rows
from lab.library.load_run import load_run

POSITIONS = np.array([[0.5, 0.0, 0.5], [0.0, 0.6, 0.4]])
CASES = {
    "drift": ({"drift_mm_per_h": 2.0}, "drift"),
    "sessions": ({"bump_mm": 1.0}, "session.2"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("group", CASES)
def test_the_motion_has_the_size_of_its_parameters(group: str, tmp_path: Path) -> None:
    options, prefix = CASES[group]
    day = lab.simulate("irb120", poses=50, seed=4, instrument="uniform-8um", **options).measurements
    result = lab.identify(day, robot="irb120", instrument="uniform-8um", model=group)
    result.write(tmp_path)
    calibrated = load_run(tmp_path, accept_edited=True)
    (found,) = fitted_motions(calibrated, fitted_rows(calibrated).rows, POSITIONS)
    values = {row.name: row.estimate for row in result.parameters}
    shift = np.array([values[f"{prefix}.{axis}"] for axis in "xyz"])
    turn = np.array([values[f"{prefix}.r{axis}"] for axis in "xyz"])
    hours = np.ptp(day.conditions["time_s"]) / 3600 if group == "drift" else 1.0
    moved = shift + np.cross(turn, POSITIONS) + values.get(f"{prefix}.scale", 0.0) * POSITIONS
    assert found.offset_m == pytest.approx(hours * np.sqrt((moved**2).sum(axis=1).mean()), rel=1e-6)
    assert found.offset_m > 1e-4 and "base or instrument" in found.detail
