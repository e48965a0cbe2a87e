"""Findings about the errors of a campaign: what nothing supports."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.mistakes import ARM, session_with_noise

from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.core.checks import Check
from lab.core.measurements import Measurements
from lab.noise.error_model import ErrorModel
from lab.phrases.phrase import phrase
from lab.verdict.noise_findings import (
    COMMON_NOISE_M,
    COMMON_SCATTER_M,
    shared_error_findings,
)

UNTESTED = Check("lack_of_fit.nothing", "not tested")
REPEATED = Check("lack_of_fit.repeats", "passed", p=0.5)


@pytest.fixture(scope="module")
def good() -> list[Measurements]:
    return [session_with_noise(seed)[0] for seed in range(6)]


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
