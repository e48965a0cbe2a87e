"""A draw-wire: lengths of a measured arm, and anchors that were moved."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.observed_files import cable_file

from lab.calibration.fit_options import FitOptions
from lab.calibration.identification import identify
from lab.calibration.row_groups import configurations, split_by_label
from lab.calibration.statistics.joint_rounding import rounding
from lab.prediction.validation import errors_of
from lab.sensors.cable import Cable, CableSensor, with_sessions


@pytest.mark.thorough
def test_a_draw_wire() -> None:
    """Three anchors: at most 0.36 mm on rows held out (0.264 is the rounding of the joints alone)."""
    arm, data = cable_file()
    observation, seen = CableSensor().observation(arm, with_sessions(data, (0, 140, 506)), arm.nominal())
    assert isinstance(observation, Cable) and observation.labels == ("1", "2", "3")
    assert [warning for warning in seen.warnings if warning.startswith("row 950: its point is 99")]
    before, after = [], []
    for seed in range(2):
        rows, held = split_by_label(configurations(seen.joints), 0.3, seed)
        found = identify(observation, seen[rows], arm.nominal(), options=FitOptions(prior="on"))
        assert found.status == "converged" and len(found.fit.free) == 31
        errors = errors_of(found, seen[held])
        before.append(np.sqrt(np.mean(errors.before**2)))
        after.append(np.sqrt(np.mean(errors.after**2)))
    assert 0.27e-3 < np.mean(after) <= 0.36e-3 and np.mean(after) < np.mean(before)
    values = dict(zip(found.model.names, found.values, strict=True))
    assert 0.055 < values["tool.p1.z"] < 0.065  # as the README of the data has it
    assert values["cable.offset"] == pytest.approx(-12.5e-3, abs=2e-3)
    limit = rounding(found.model, seen, found.values)
    assert limit is not None and np.rad2deg(limit.step_rad) == pytest.approx(0.1)
    assert 0.25e-3 < limit.rms_m < 0.28e-3


@pytest.mark.thorough
def test_sessions_that_are_found_begin_at_rows_of_the_file() -> None:
    """Rows without a length are no part of the search, and count in the file all the same."""
    arm, data = cable_file()
    found = CableSensor().with_sessions(arm, data, arm.nominal())
    lengths = data.conditions["cable_mm"].copy()
    lengths[:30] = np.nan
    fewer = CableSensor().with_sessions(arm, replace(data, conditions={"cable_mm": lengths}), arm.nominal())
    for sessions in (found.sessions, fewer.sessions):
        starts = [i for i in range(1, len(data)) if sessions[i] != sessions[i - 1]]
        assert len(starts) == 2 and abs(starts[0] - 140) <= 2 and abs(starts[1] - 506) <= 2
    assert "3 anchors; name them in a column session" in found.warnings[-1]
    named = replace(data, sessions=("a",) * len(data))
    assert CableSensor().with_sessions(arm, named, arm.nominal()) is named
