"""The pictures by which a fit is checked: what their labels say, against the numbers themselves."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.campaigns import calibration

from lab.library.calibration_result import stiffnesses
from lab.report.views.calibration_figures import correlation_picture, residual_pictures, uncertainty_map


def test_residuals_show_a_trend_where_there_is_one_and_no_other(seven) -> None:
    labels = {picture.name: picture.label for picture in residual_pictures(seven)}
    assert sum(label.endswith("no trend") for label in labels.values()) == len(labels) - 1 == 9  # joints, and x y z
    assert labels["residuals-normal"].startswith("Q-Q: ")
    off = seven.measurements.points.copy()
    off[25:, :, 0] += 0.05e-3  # the instrument moved along x
    moved = replace(seven, state=replace(seven.state, rows=replace(seven.state.rows, points=off)))
    labels = {picture.name: picture.label for picture in residual_pictures(moved)}
    assert "no trend" not in labels["residuals-time-0"] and labels["residuals-time-2"].endswith("no trend")


def test_the_strongest_correlation_is_named(seven) -> None:
    (picture,) = correlation_picture(seven)
    found = seven.identification
    matrix = np.corrcoef(np.random.default_rng(0).multivariate_normal(np.zeros(len(found.std)),
                         found.covariance / np.outer(found.std, found.std), 4000).T)  # fmt: skip
    i, j = np.unravel_index(np.abs(np.triu(matrix, 1)).argmax(), matrix.shape)
    names = [found.model.names[k] for k in found.fit.free]
    assert names[i] in picture.label and names[j] in picture.label


def test_predicted_errors_are_those_of_the_verdict_and_extrapolation_is_marked(seven) -> None:
    shown = uncertainty_map(seven)
    assert np.sqrt(np.mean(shown.sizes**2)) == pytest.approx(seven.verdict.workspace.rms_m, rel=0.02)
    few = replace(seven, state=replace(seven.state, rows=seven.fitted[:2]))
    beyond = uncertainty_map(few)
    assert shown.extrapolated.sum() < 0.5 * len(shown.points)
    assert beyond.extrapolated.sum() > 0.9 * len(beyond.points)  # two poses span next to nothing


@pytest.mark.thorough
def test_stiffness_is_that_of_compliance_and_not_of_its_change_with_torque() -> None:
    """Springs that soften with torque have a positive term of the third power, which is no compliance."""
    soft = {"stiffness_nm_per_rad": 3e4, "hardening_mrad": 0.3, "payload_kg": (0.0, 3.0)}
    found = calibration(seed=3, model="compliance+hardening", **soft)
    values = np.abs(found.identification.values)
    softening = stiffnesses(replace(found.identification, values=values), found.robot.chain)
    assert [each.joint for each in softening] == ["q2", "q3"]
    assert [each.stiffness for each in softening] == pytest.approx([3e4, 3e4], rel=0.05)
