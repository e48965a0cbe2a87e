"""Findings about the errors of a campaign: what changed, and what nothing supports."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.mistakes import ARM, MISTAKES, session_with_noise

from lab.calibration.identification import identify
from lab.calibration.noise_search import search_noise
from lab.calibration.observation import observation_of
from lab.calibration.statistics.goodness_of_fit import repeats
from lab.calibration.weights import Noise, weigh
from lab.core.checks import Check
from lab.core.measurements import Measurements
from lab.noise.error_model import ErrorModel
from lab.phrases.phrase import phrase
from lab.verdict.noise_findings import (
    COMMON_NOISE_M,
    COMMON_SCATTER_M,
    changes_in_time,
    shared_error_findings,
)

UNTESTED = Check("lack_of_fit.nothing", "not tested")
REPEATED = Check("lack_of_fit.repeats", "passed", p=0.5)


def changes(data: Measurements, noise: Noise = Noise()) -> list:  # noqa: B008
    found = identify(ARM, data, ARM.nominal(), noise)
    return changes_in_time(found, weigh(observation_of(found.model), data, noise)[0], data)


@pytest.fixture(scope="module")
def good() -> list[Measurements]:
    return [session_with_noise(seed)[0] for seed in range(6)]


def test_a_session_without_mistakes_has_no_findings(good: list[Measurements]) -> None:
    assert [changes(data) for data in good] == [[]] * len(good)  # 3 in 100 by chance


@pytest.mark.parametrize(
    ("mistake", "what"),
    [
        ("the tracker moved half way", "position of the base"),
        ("the tracker turned", "position of the base"),
        ("a zero shifted", "zero of joint"),
        ("the reflector was reseated", "tool point p1"),
        ("half commanded, half read back", "times as large"),
    ],
)
def test_a_change_is_found_where_it_happened(mistake: str, what: str) -> None:
    data, rng = session_with_noise(1)
    (found,) = changes(MISTAKES[mistake](data, rng, 0.1e-3))
    assert what in phrase(found) and found.outcome == "failed" and found.name == "finding.change"
    assert data.ids.index(found.data["between"][1]) == pytest.approx(30, abs=6)


def test_an_arm_that_grows_is_found_and_by_how_much() -> None:
    """About its base, by 60 ppm: steadily, or at once half way, as by another scale of the instrument."""
    data, _ = session_with_noise(0)
    since, last = np.linspace(0, 1, len(data)), len(data) - 1
    away = data.points - identify(ARM, data, ARM.nominal()).values[:3]
    reach = float(np.sqrt(np.mean(np.sum(away**2, axis=-1))))
    for by, rows in ((since, (0, last)), (since > 0.5, (29, 30))):
        (found,) = changes(replace(data, points=data.points + 60e-6 * by[:, None, None] * away))
        assert "the size of the arm" in phrase(found) and found.name == "finding.change"
        assert found.data["size_m"] == pytest.approx(60e-6 * reach, rel=0.15)
        assert [data.ids.index(each) for each in found.data["between"]] == pytest.approx(rows, abs=2)
    assert changes(replace(data, points=data.points + 60e-6 * away)) == []  # a scale, which no row shows


def shared(data: Measurements, **sizes: float) -> ErrorModel:
    carry = sizes.pop("carry", 0.0)
    return ErrorModel(9e-6, 1.0, sizes, None, {}, carry)


def test_only_repeats_support_scatter_and_only_of_a_common_size(good: list[Measurements]) -> None:
    data, alone = good[0], np.arange(len(good[0]))
    found = identify(ARM, data, ARM.nominal())
    small, large = shared(data, scatter=0.03e-3), shared(data, scatter=0.5e-3)
    cases = ((small, REPEATED, True), (small, UNTESTED, False), (large, REPEATED, False))
    for errors, adequacy, supported in cases:
        (finding,) = shared_error_findings(found, data, errors, adequacy, alone)
        assert finding.name == "finding.scatter" and (finding.outcome == "noted") is supported
        assert ("support it" in phrase(finding)) is not supported
    assert finding.data["size_m"] > COMMON_SCATTER_M
    stated = identify(ARM, data, ARM.nominal(), Noise(sigma_m=9e-6))
    (explained,) = shared_error_findings(stated, data, small, UNTESTED, alone)  # by what was stated
    assert explained.outcome == "noted"


def test_drift_is_supported_by_poses_that_were_measured_again_later(good: list[Measurements]) -> None:
    data = good[0]
    found, drift = identify(ARM, data, ARM.nominal()), shared(data, trend=10e-6)
    at_once, later = np.arange(len(data)), np.arange(len(data))
    at_once[1::2] = at_once[::2]  # two readings of each pose
    later[-1] = later[0]
    for labels, supported in ((at_once, False), (later, True)):
        (finding,) = shared_error_findings(found, data, drift, REPEATED, labels)
        assert finding.name == "finding.drift" and (finding.outcome == "noted") is supported
    assert "drifts by 35 µm" in phrase(finding)  # from beginning to end, of three axes


def test_a_step_is_never_supported_and_names_its_poses() -> None:
    data, rng = session_with_noise(3)
    moved = MISTAKES["the tracker moved half way"](data, rng, 3e-3)
    found = identify(ARM, moved, ARM.nominal())
    errors = search_noise(found, moved, Noise()).shared
    (finding, *_) = shared_error_findings(found, moved, errors, REPEATED, repeats(moved))
    assert finding.name == "finding.step" and finding.outcome == "failed"
    assert finding.data["size_m"] == pytest.approx(3e-3, rel=0.05) and "3 mm between poses" in phrase(finding)


def test_noise_beyond_common_instruments_is_a_finding_where_nobody_stated_it(good: list[Measurements]) -> None:
    data, rng = good[0], np.random.default_rng(0)
    alone = np.arange(len(data))
    for size, kinds in ((0.3 * COMMON_NOISE_M, []), (3 * COMMON_NOISE_M, ["finding.noise"])):
        noisy = replace(data, points=data.points + size * rng.normal(size=data.points.shape))
        found = identify(ARM, noisy, ARM.nominal())
        assert [each.name for each in shared_error_findings(found, noisy, None, UNTESTED, alone)] == kinds
        assert shared_error_findings(found, noisy, None, REPEATED, alone) == []
        stated = identify(ARM, noisy, ARM.nominal(), Noise(sigma_m=size))
        assert shared_error_findings(stated, noisy, None, UNTESTED, alone) == []
