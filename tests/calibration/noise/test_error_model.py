"""What is estimated of errors that measurements share, and what becomes of them in a run."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import lab
from lab.calibration.gauss_newton import Status
from lab.calibration.identification import Identification, identify
from lab.calibration.noise_search import noise_of, search_noise
from lab.calibration.statistics.outliers import Outliers
from lab.calibration.weights import Noise
from lab.core.measurements import Measurements
from lab.noise.error_model import ErrorModel, row_times
from lab.noise.error_term import TERMS
from lab.robots.load_robot import load_robot

ROBOT = load_robot("irb120")
TARGETS = ("p1", "p2", "p3")
ARM = ROBOT.arm(TARGETS)
NOMINAL = ARM.nominal(ROBOT.tool)
_NONE = np.empty(0, dtype=int)


@pytest.fixture(scope="module")
def scattered() -> lab.CalibrationResult:
    """The campaign of joints that scatter by 0.03 mrad, its noise given as 8 µm where it is 4.6."""
    return lab.calibrate(
        "irb120", seed=4000001, poses=40, targets=TARGETS, effects=lab.Effects(repeatability_mrad=0.03), noise_mm=0.008
    )


@pytest.mark.thorough
def test_scatter_is_found_and_the_prediction_is_that_of_the_real_error(scattered: lab.CalibrationResult) -> None:
    said = scattered.to_dict()
    assert said["noise_model"]["joint_scatter_mrad"] == pytest.approx(0.03, rel=0.25)
    assert said["noise_model"]["independent_mm"] == pytest.approx(0.008 / np.sqrt(3), rel=0.1)
    assert said["noise_model"]["drift_mm"] == said["noise_model"]["wandering_mm"] == 0
    assert 0.5 < said["after_mm"]["rms"] / said["predicted_mm"] < 1.5  # without scatter it is 2.4
    assert said["truth"]["nees_per_parameter"] < 2.0  # without scatter it is 7.5 on average
    assert not said["outliers"] and said["adequate"] is False  # above the noise given; the same residuals say why
    assert "as if joints scatter" in said["adequacy"] and said["verdict"] == "doubtful"
    assert scattered.state.noise.shared.descriptions == ("joints scatter by 0.031 mrad from pose to pose",)


def test_independent_noise_is_left_as_it_was() -> None:
    day = lab.simulate("irb120", seed=3, poses=40, targets=TARGETS)
    found = identify(ARM, day.measurements, NOMINAL, Noise())
    search = search_noise(found, day.measurements, Noise())
    assert search.shared is None and search.corrected(found) is found
    assert {trial.kind for trial in search.trials} == {term.kind for term in TERMS}


@dataclass(frozen=True)
class _Ended:
    """Fits that end with a status, and no poses that are off."""

    status: Status
    noise: Noise = field(default_factory=Noise)
    encoders: None = None

    def fitted(self, rows: Measurements, shared: ErrorModel | None) -> Identification:
        found = identify(ARM, rows, NOMINAL, replace(self.noise, shared=shared))
        return replace(found, fit=replace(found.fit, status=self.status))

    def outliers(self, found: Identification, rows: Measurements, shared: ErrorModel | None) -> Outliers:
        return Outliers(_NONE, np.empty(0), np.empty(0), found.fit, np.ones(len(rows)), False, 0.01, _NONE)


def test_what_a_fit_in_a_valley_leaves_is_not_taken_for_noise(scattered: lab.CalibrationResult) -> None:
    rows = scattered.measurements
    assert noise_of(_Ended("converged"), rows).shared is not None
    search = noise_of(_Ended("in a valley"), rows)
    assert search.shared is None and not search.trials and not search.undecided


def test_rows_are_in_time_by_their_clock_else_by_their_place() -> None:
    day: Measurements = lab.simulate("irb120", seed=3, poses=6).measurements
    assert row_times(day[[4, 1]]).tolist() == [4.0, 1.0]
    timed = replace(day, conditions={"time_s": np.array([0.0, 60.0, 120.0, 180.0, 600.0, 660.0])})
    assert row_times(timed).tolist() == [0.0, 1.0, 2.0, 3.0, 10.0, 11.0]
    two = replace(day, sessions=("a", "a", "a", "b", "b", "b"))
    assert row_times(two)[3] - row_times(two)[2] > 1e5
