"""Warnings name what it was: the instrument where its targets show it, the arm before its poses, bad poses as bad."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.campaigns import session

import lab
from lab.commands.calibrate.run import CalibrationResult


def identified(seed: int, day: dict[str, object], **options: object) -> CalibrationResult:
    measured = lab.simulate("irb120", seed=seed, **day).measurements
    return lab.identify(measured, robot="irb120", seed=seed, **options)


@pytest.mark.thorough
@pytest.mark.parametrize("robust", [False, True])
def test_who_holds_out_bad_readings_is_never_good(robust: bool) -> None:
    """A fifth of the poses is off. Who leaves them out of the fit is told of them in the hold-out set."""
    day = {"poses": 80, "bad_share": 0.2, "instrument": "uniform-8um"}
    for seed in range(2):
        result = identified(seed, day, holdout=0.3, robust=robust, noise_mm=0.005, gate_mm=100.0 if robust else None)
        found = result.to_dict()
        assert found["verdict"] != "good"
        if robust:  # a fit that is spoilt by them need not name them
            named = sum(pose["held_out"] for pose in found["outliers"])
            assert result.validation.rows is not None and named > 0.05 * len(result.validation.rows)
            assert any("of the hold-out set are outliers" in reason for reason in found["reasons"])
            assert found["after_mm"]["mean"] > 5 * found["after_without_outliers_mm"]["mean"]
    clean = identified(0, {**day, "bad_share": 0.0}, holdout=0.3, robust=robust, noise_mm=0.005, gate_mm=100.0)
    assert clean.to_dict()["verdict"] == "good" and clean.validation.outlier_share == 0


@pytest.mark.thorough
def test_one_blunder_that_is_excluded_spoils_no_verdict_but_many_do() -> None:
    day = lab.simulate("irb120", seed=5, poses=50, instrument="uniform-8um").measurements
    found = {}
    for name, bad, robust in (
        ("clean", [], True),
        ("one", [10], True),
        ("many", range(8), True),
    ):
        points = day.points.copy()
        points[list(bad), 0] += [10.0, 0.0, 0.0]
        spoilt = replace(day, points=points)
        found[name] = lab.identify(spoilt, robot="irb120", instrument="uniform-8um", robust=robust).to_dict()
    assert found["clean"]["verdict"] == found["one"]["verdict"] == "good"
    assert "--robust excludes 1 outlier from fit and verdict: pose 10 (10,000 mm)" in found["one"]["warnings"]
    assert found["one"]["after_mm"]["max"] > 9e3 > 1 > found["one"]["after_without_outliers_mm"]["max"]
    assert found["many"]["verdict"] == "bad"


@pytest.mark.thorough
def test_isotropy_is_the_instruments_only_where_several_targets_show_it() -> None:
    tracker = identified(4, {"poses": 60, "targets": ("p1", "p2", "p3"), "instrument": "leica-at960"})
    said = [words for words in tracker.to_dict()["warnings"] if "line of sight" in words or "isotropic" in words]
    assert len(said) == 1 and "--instrument" in said[0] and "the arm may cause" not in said[0]
    arm: list[str] = []
    for seed in range(2):  # an arm that bends, seen by an instrument without any direction
        day = {"poses": 60, "stiffness_nm_per_rad": 2e4, "payload_kg": (0.0, 3.0), "instrument": "uniform-8um"}
        arm += identified(seed, day).to_dict()["warnings"]
    uneven = [warning for warning in arm if "line of sight" in warning]
    assert uneven and all("--model auto" in warning for warning in uneven)
    assert not any("--instrument" in warning for warning in uneven)


@pytest.mark.thorough
def test_auto_is_proposed_before_poses_are_blamed() -> None:
    day = {"poses": 80, "bad_share": 0.05, "instrument": "uniform-8um"}
    said = [w for w in identified(2, day).to_dict()["warnings"] if "outliers" in w and "--robust" in w]
    assert said and np.all([w.index("--model auto") < w.index("--robust") for w in said])
    again = [w for w in identified(2, day, model="auto").to_dict()["warnings"] if "--robust" in w]
    assert again and not any("--model auto" in w for w in again)


@pytest.mark.thorough
def test_where_scatter_cannot_be_told_from_the_arm_the_intervals_are_those_of_whole_poses() -> None:
    day = {"poses": 40, "targets": ("p1", "p2", "p3"), "repeatability_mrad": 0.03, "harmonic_mrad": 0.1}
    undecided = identified(3, day)
    (said,) = [words for words in undecided.to_dict()["warnings"] if "cluster-robust" in words]
    assert "are confounded" in said and said.endswith("--model auto searches for effects of the arm")
    assert undecided.to_dict()["cluster_robust"] and undecided.to_dict()["noise_model"] is None
    found = undecided.identification
    assert found.dof_each is not None and (found.dof_each < found.dof / 3).all()  # 40 clusters, not 360 numbers
    plain = found.residual_sigma_m * np.sqrt(np.diag(found.fit.unit_covariance()))
    assert np.mean(found.std > 1.1 * plain) > 0.5  # three targets of a pose err together
    told = identified(3, {**day, "harmonic_mrad": 0.0})
    assert not told.to_dict()["cluster_robust"] and told.to_dict()["noise_model"] is not None
    assert not any("cluster-robust" in words for words in told.to_dict()["warnings"])


WRONG = {
    "wrong unit: the points are in inches where mm are expected": lambda day: replace(day, points=day.points / 25.4),
    "wrong unit: the joint positions are in radians": lambda day: replace(day, joints=np.deg2rad(day.joints)),
    "the points are mirrored": lambda day: replace(day, points=day.points[..., [1, 0, 2]]),
    "for any base and tool: wrong rows": lambda day: replace(day, points=np.roll(day.points, 1, axis=0)),
}


SOON = "the points are mirrored"  # the others with -m slow: searches among nonsense take long


@pytest.mark.thorough
@pytest.mark.parametrize(
    "says", [SOON, *(pytest.param(each, marks=pytest.mark.slow) for each in WRONG if each != SOON)]
)
def test_numbers_in_another_unit_or_of_other_poses_are_the_first_reason(says: str) -> None:
    day = session(seed=3, poses=40, instrument="uniform-8um").measurements
    found = lab.identify(WRONG[says](day), instrument="uniform-8um").to_dict()
    assert found["verdict"] == "bad" and says in found["reasons"][0]


@pytest.mark.thorough
def test_an_error_above_the_gate_is_the_first_reason() -> None:
    day = session(seed=3, poses=40, instrument="uniform-8um").measurements
    gated = lab.identify(day, instrument="uniform-8um", gate_mm=0.001).to_dict()
    assert gated["verdict"] == "bad" and "above the gate" in gated["reasons"][0]
