"""Warnings name what it was: the instrument where its targets show it, the arm before its poses, bad poses as bad."""

from dataclasses import replace

import numpy as np
import pytest

import lab
from lab.library.calibration_result import CalibrationResult


def identified(seed: int, day: dict[str, object], **options: object) -> CalibrationResult:
    measured = lab.simulate("irb120", seed=seed, **day).measurements
    return lab.identify(measured, robot="irb120", seed=seed, **options)


@pytest.mark.thorough
def test_who_holds_out_bad_readings_is_never_good() -> None:
    """A fifth of the poses is off. Who leaves them out of the fit is told of them in the hold-out set."""
    day = {"poses": 80, "bad_share": 0.2, "instrument": "uniform-8um"}
    result = identified(0, day, holdout=0.3, robust=True, noise_mm=0.005, gate_mm=100.0)
    found = result.to_dict()
    assert found["verdict"] != "good" and result.validation.rows is not None
    assert sum(pose["held_out"] for pose in found["outliers"]) > 0.05 * len(result.validation.rows)
    assert found["after_mm"]["mean"] > 5 * found["after_without_outliers_mm"]["mean"]
    clean = identified(0, {**day, "bad_share": 0.0}, holdout=0.3, robust=True, noise_mm=0.005, gate_mm=100.0)
    assert clean.to_dict()["verdict"] == "good" and clean.validation.outlier_share == 0


@pytest.mark.thorough
def test_one_blunder_that_is_excluded_spoils_no_verdict_but_many_do() -> None:
    day = lab.simulate("irb120", seed=5, poses=50, instrument="uniform-8um").measurements
    found = {}
    for name, bad in (("one", [10]), ("many", range(0, 48, 6))):  # in a row they would be a step
        points = day.points.copy()
        points[list(bad), 0] += [10.0, 0.0, 0.0]
        spoilt = replace(day, points=points)
        found[name] = lab.identify(spoilt, robot="irb120", instrument="uniform-8um", robust=True).to_dict()
    assert found["one"]["verdict"] == "good"
    assert found["one"]["after_mm"]["max"] > 9e3 > 1 > found["one"]["after_without_outliers_mm"]["max"]
    assert found["many"]["verdict"] == "bad"


@pytest.mark.thorough
def test_where_scatter_cannot_be_told_from_the_arm_the_intervals_are_those_of_whole_poses() -> None:
    day = {"poses": 40, "targets": ("p1", "p2", "p3"), "repeatability_mrad": 0.03, "harmonic_mrad": 0.1}
    undecided = identified(3, day)
    assert undecided.to_dict()["cluster_robust"] and undecided.to_dict()["noise_model"] is None
    found = undecided.identification
    assert found.dof_each is not None and (found.dof_each < found.dof / 3).all()  # 40 clusters, not 360 numbers
    plain = found.residual_sigma_m * np.sqrt(np.diag(found.fit.unit_covariance()))
    assert np.mean(found.std > 1.1 * plain) > 0.5  # three targets of a pose err together
    told = identified(3, {**day, "harmonic_mrad": 0.0})
    assert not told.to_dict()["cluster_robust"] and told.to_dict()["noise_model"] is not None
