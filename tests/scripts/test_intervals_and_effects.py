"""The virtual studies that decide whether intervals and tests are honest: small here, whole where marked slow."""

import pytest
from helpers.run_script import answer_in_processes, answer_of


@pytest.mark.thorough
def test_intervals_hold_a_little() -> None:
    """4 robots x 15 draws of 27 intervals: the mean's sigma is 0.5 %, more as a campaign's hang together."""
    cases = ("Gaussian, known", "Gaussian, estimated", "spherical taken for isotropic", "compliance missing")
    found = answer_of("honest_intervals.py", "--robots", 4, "--draws", 15, "--cases", *cases[:2])
    found |= answer_of(
        "honest_intervals.py", "--robots", 4, "--draws", 5, "--cases", *cases[2:]
    )  # which are plain from fewer
    for case in cases[:2]:
        assert found[case]["coverage_mean"] == pytest.approx(0.95, abs=0.015)
        assert found[case]["nees"] == pytest.approx(1.0, abs=0.06)  # 200 means of 27: sigma 0.019
        assert found[case]["variance_over_bound_mean"] == pytest.approx(1.0, abs=0.06)
    assert found[cases[0]]["inadequate"] <= 0.1 and found[cases[3]]["inadequate"] > 0.97
    assert found[cases[2]]["anisotropy_said"] > 0.2 and found[cases[1]]["anisotropy_said"] < 0.03
    assert found[cases[3]]["coverage_mean"] < 0.3  # intervals of a model that lacks something are not to be believed


@pytest.mark.slow
def test_intervals_hold() -> None:
    """10,000 campaigns a case."""
    found = answer_in_processes("honest_intervals.py")
    for case in ("Gaussian, known", "Gaussian, estimated", "spherical, weighed"):
        result = found[case]
        assert result["campaigns"] == 10_000
        assert result["coverage_least"] >= 0.942 and result["coverage_largest"] <= 0.958
        assert result["nees"] == pytest.approx(1.0, abs=0.02)
        assert result["variance_over_bound_least"] >= 0.95 and result["variance_over_bound_largest"] <= 1.05
        assert result["variance_over_bound_mean"] == pytest.approx(1.0, abs=0.03)
    assert found["Gaussian, known"]["inadequate"] == pytest.approx(0.05, abs=0.01)
    assert found["compliance missing"]["inadequate"] > 0.99
    assert found["spherical taken for isotropic"]["anisotropy_said"] == pytest.approx(0.37, abs=0.05)


@pytest.mark.slow
def test_bending_links_are_found_and_never_taken_for_joint_springs() -> None:
    flags = ("--arms", 100, "--rigid", 300, "--curve", 20, "--intervals", 1000)
    found = answer_in_processes("elastic_links_found.py", *flags)
    for case in found["cases"].values():
        assert case["right"] >= 0.95 * case["arms"] and case["fresh_over_bound"]["mean"] <= 1.3
    for share in found["intervals"].values():
        assert 0.93 <= share <= 0.97
    for point in found["curve"]:
        if point["left_um"] > 3:
            assert point["found"] >= 0.95 * point["arms"]
        assert point["springs alone"] <= 0.05 * point["arms"]  # else that it cannot be told apart is the right answer


@pytest.mark.slow
def test_the_verdict_is_seldom_wrong() -> None:
    """Campaigns of known quality, some of them of another robot, in other units or signs, or with a mistake."""
    found = answer_of("verdict_quality.py", "--campaigns", 2000, "--wrong", 0.2)
    assert sum(sum(of.values()) for of in found["confusion"].values()) == 2000
    counted = {quality: sum(of.values()) for quality, of in found["confusion"].items()}
    assert min(count for quality, count in counted.items() if quality != "not shown") >= 200
    assert found["false_good"] <= 0.01 and found["false_alarm"] <= 0.05
