"""The table of verdicts: calibrations whose quality is known, with the word and the reason that each must get."""

import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from helpers.judged import Case, campaign, errors

from lab.calibration.fit_options import PLAIN
from lab.core.checks import Check
from lab.kinematics.serial.serial_arm import SerialArm
from lab.phrases.phrase import in_one_line
from lab.prediction.validation import Validation
from lab.prediction.workspace_prediction import prediction_check
from lab.robots.load_robot import load_robot
from lab.verdict.noise_findings import finding
from lab.verdict.verdict import judge, verdict

GATE = 1e-3
clean = cache(campaign)


@dataclass(frozen=True)
class Row:
    """What a calibration is, under which gate (m), its verdict, the failed check (and link), and over which region."""

    made: Callable[[], Case]
    gate_m: float | None
    word: str
    reason: str = ""
    everywhere: bool = False


def judged_by(errors_before, errors_after, made: Callable[[], Case] = clean, **more) -> Callable[[], Case]:
    """A campaign with other errors at the validation poses (mm)."""
    return lambda: replace(made(), validation=Validation("holdout", errors(errors_before, errors_after), **more))


def validated(**more) -> Callable[[], Case]:
    """A good campaign with something else about its validation."""
    return lambda: replace(clean(), validation=replace(clean().validation, **more))


def scattered(sigma_m: float) -> Callable:
    """Points that no arm would make."""
    return lambda points, rng: points + sigma_m * rng.normal(size=points.shape)


def made(**options) -> Callable[[], Case]:
    return lambda: campaign(**options)


def unconverged() -> Case:
    case = clean()
    return replace(case, found=replace(case.found, fit=replace(case.found.fit, status="not converged")))


def joint_that_never_moved() -> Case:
    still = np.array([1.0, 1.0, 1.0, 1.0, 0.0, 1.0])
    return campaign(moved_as=lambda q: q * still)


RNG = np.random.default_rng(0)
SPREAD = np.sort(RNG.gamma(9.0, size=200))
SPREAD /= SPREAD.mean()
GROWN = 0.276 * SPREAD + 1e-3 * np.where(np.arange(200) < 199, -1.0, 199.0)  # the same mean, a larger maximum
TABLE = {
    # good, or good because what is amiss does not matter
    "clean, with a gate": Row(clean, GATE, "good"),
    "clean, without a gate": Row(clean, None, "good"),
    "noise estimated, but far below the gate": Row(made(known=False), GATE, "good"),
    "lack of fit, but far below the gate": Row(made(points_as=scattered(50e-6)), GATE, "good"),
    "a link 16 tolerances off, but sure, and below the gate": Row(made(change={"link3.a": 8e-3}), GATE, "good"),
    "condition 500, but predicted below the gate": Row(made(poses=12, range_share=0.2), GATE, "good"),
    "condition 2,600, in a small part of the workspace, where it is accurate": Row(
        made(poses=12, range_share=0.1, validated_share=0.1), 0.5e-3, "good"
    ),
    "the same without any gate": Row(made(poses=12, range_share=0.1, validated_share=0.1), None, "good"),
    "the noise is given too large": Row(made(sigma_m=0.0), None, "good"),
    "nothing differs from nominal": Row(
        judged_by(0.018 * SPREAD, 0.018 * SPREAD), None, "good"
    ),
    # doubtful
    "noise estimated, and no gate": Row(made(known=False), None, "doubtful", "lack_of_fit.nothing"),
    "lack of fit, and no gate": Row(made(points_as=scattered(50e-6)), None, "doubtful", "lack_of_fit.chi2"),
    "lack of fit, and errors near the gate": Row(
        made(points_as=scattered(50e-6)), 60e-6, "doubtful", "lack_of_fit.chi2"
    ),
    "condition 2,700, and lack of fit": Row(
        made(poses=12, range_share=0.1, validated_share=0.1, points_as=scattered(0.2e-3)), None, "doubtful",
        "determination.limit",
    ),
    "the same over the workspace": Row(
        made(poses=12, range_share=0.1, validated_share=0.1, points_as=scattered(0.2e-3)), None, "doubtful",
        "determination.limit", everywhere=True,
    ),
    "condition 2,600, noise alone, predicted above the gate over the workspace": Row(
        made(poses=12, range_share=0.1, validated_share=0.1), 0.5e-3, "doubtful", "determination.limit",
        everywhere=True,
    ),
    "0.280 to 0.276 mm, and the largest error grew": Row(
        judged_by(0.280 * SPREAD, GROWN), GATE, "doubtful",
        "accuracy.gain",
    ),
    "0.280 to 0.276 mm": Row(judged_by(0.280 * SPREAD, 0.276 * SPREAD), None, "doubtful", "accuracy.gain"),
    "a link 16 tolerances off, and no gate": Row(
        made(change={"link3.a": 8e-3}), None, "doubtful", "links.tolerances link3.a"
    ),
    "a tenth of the validation poses were fitted": Row(
        validated(fitted_share=0.1), GATE, "doubtful", "accuracy.fitted_poses"
    ),
    "accuracy.outliers": Row(
        validated(outlier_share=0.08), GATE, "doubtful", "accuracy.outliers"
    ),
    "the gate is below the noise": Row(
        judged_by(0.5 * SPREAD, 0.022 * SPREAD), 13.8e-6, "doubtful", "accuracy.gate_below_noise"
    ),
    # not judged
    "no poses to validate on": Row(
        lambda: replace(clean(), validation=Validation(None, None)), GATE, "not judged"
    ),
    "a file validated on itself": Row(
        validated(fitted_share=1.0), GATE, "not judged", "accuracy.validation"
    ),
    # bad
    "the mean is above the gate": Row(clean, 5e-6, "bad", "accuracy.gate"),
    "the mean is above the gate by more than noise": Row(
        judged_by(0.5 * SPREAD, 0.1 * SPREAD), 0.05e-3, "bad", "accuracy.gate"
    ),
    "worse than nominal": Row(judged_by(0.2 * SPREAD, 0.3 * SPREAD), GATE, "bad", "accuracy.worse"),
    "no gate, but worse than tolerances alone": Row(
        judged_by(9 * SPREAD, 3 * SPREAD), None, "bad", "accuracy.gate"
    ),
    "all measured points are zero": Row(
        made(points_as=lambda points, _: 0 * points), GATE, "bad", "arm.constant_points"
    ),
    "metres taken for millimetres": Row(
        made(points_as=lambda points, _: 1e-3 * points), GATE, "bad"
    ),
    "radians taken for degrees": Row(made(poses=15, joints_as=np.deg2rad), None, "bad", "arm.convergence"),
    "points of nothing": Row(
        made(poses=15, points_as=lambda p, rng: 0.4 * rng.normal(size=p.shape)), GATE, "bad", "accuracy.gate"
    ),
    "another robot of the same reach": Row(
        lambda: campaign(model=SerialArm(load_robot("scemi").chain)), GATE, "bad", "links.other_robot link2.theta"
    ),
    "another robot, twice as large": Row(
        lambda: campaign(model=SerialArm(load_robot("ur10").chain)), GATE, "bad", "arm.convergence"
    ),
    "all joints negated": Row(made(joints_as=np.negative), GATE, "bad", "links.other_robot link5.theta"),
    "the last joint negated": Row(
        made(joints_as=lambda q: q * [1, 1, 1, 1, 1, -1]), GATE, "bad", "links.other_robot link5.theta"
    ),
    "two joints exchanged": Row(
        made(joints_as=lambda q: q[:, [0, 1, 2, 4, 3, 5]]), GATE, "bad", "links.other_robot link5.theta"
    ),
    "link6.a 253 mm off": Row(
        made(change={"link6.a": 0.253}, options=replace(PLAIN, fix=("tool.p1.x",), free=("link6.a",))), GATE, "bad",
        "links.other_robot link6.a",
    ),
    "a joint's zero 20° off": Row(
        made(change={"link3.theta": np.deg2rad(20)}), None, "bad", "links.other_robot link3.theta"
    ),
    "not converged": Row(unconverged, GATE, "bad", "arm.convergence"),
    "a joint that never moved": Row(joint_that_never_moved, GATE, "bad", "arm.identifiable"),
}  # fmt: skip


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", TABLE)
def test_the_table(name: str) -> None:
    row = TABLE[name]
    case = row.made()
    poses = None if row.everywhere else case.poses
    found = verdict(case.found, case.validation, row.gate_m, goodness=case.goodness, poses=poses)
    assert found.word == row.word, found.reasons
    name, _, link = row.reason.partition(" ")
    reasons = {each.name: each for each in found.reasons}
    assert not name or (name in reasons and (not link or reasons[name].data["distance"].name == link)), reasons
    assert found.gate_m == row.gate_m and (found.word != "good" or not found.reasons)


@pytest.mark.parametrize("made", [unconverged, made(points_as=lambda points, _: 0 * points)])
def test_no_answer_is_good_news_of_a_fit_that_is_not_of_this_arm(made: Callable[[], Case]) -> None:
    case = made()
    found = verdict(case.found, case.validation, GATE)
    assert found.word == "bad" and not {each.standing for each in found.answers.values()} & {"holds", "does not matter"}
    assert verdict(clean().found, clean().validation, GATE).accuracy.standing == "holds"


def test_the_verdict_is_a_function_of_its_checks_alone() -> None:
    """The same checks, of another process; one more that fails; and none that says what may be wrong."""
    case = campaign(points_as=scattered(50e-6))
    found = verdict(case.found, case.validation, goodness=case.goodness, poses=case.poses)
    again = judge(pickle.loads(pickle.dumps(found.checks)), found.gate_m)
    assert repr(again) == repr(found)  # as text: NaN is not equal to itself
    assert found.word == "doubtful" and [each.name for each in found.reasons] == ["lack_of_fit.chi2"]
    foreign = Check("arm.convergence", "failed", np.inf, data={"status": "in a valley"})
    bad = judge((*found.checks, foreign, finding("drift", 1e-3)))
    assert bad.word == "bad" and bad.reasons == (foreign,) and bad.accuracy.standing == "not judged"
    rest = [each for each in found.checks if each.outcome != "failed"]
    assert judge(rest).word == "good"


def lack_of_fit(p: float) -> Check:
    return Check("lack_of_fit.joints", "failed", 2.0, p, 0.05, {"tests": [Check("lack_of_fit.joints", "failed")]})


def test_the_predicted_95_percent_error_counts_where_lack_of_fit_is_sure() -> None:
    """What a model lacks is larger elsewhere; at the warning's level one clean campaign in twenty would be doubted."""
    case = clean()
    region = verdict(case.found, case.validation).region
    gate_m = float(np.sqrt(region.mean_m * region.p95_m))  # the mean lies below it
    held_out = Validation("holdout", errors(0.5 * SPREAD, 0.2e3 * gate_m * SPREAD))
    words = {}
    for p in (0.03, 0.003):
        found = verdict(case.found, held_out, gate_m, goodness=lack_of_fit(p))
        words[p] = found.word, in_one_line(found.reasons)
    assert words[0.03] == ("good", "")
    assert words[0.003][0] == "doubtful" and "with the lack of fit it is above the gate" in words[0.003][1]


def test_a_finding_that_nothing_supports_makes_a_good_calibration_doubtful() -> None:
    case = clean()

    def judged(*findings: Check, gate_m: float | None = None):
        return verdict(case.found, case.validation, gate_m, goodness=case.goodness, findings=findings)

    assert judged(finding("scatter", 1e-3, supported=True)).word == "good"
    doubtful = judged(finding("missing", 1e-3), finding("scatter", 1e-3))
    assert doubtful.word == "doubtful"
    assert [each.name for each in doubtful.reasons] == ["finding.missing", "finding.scatter"]
    assert judged(finding("scatter", 1e-3), gate_m=GATE).word == "good"  # far below the gate it does not matter


def test_errors_beyond_their_prediction_are_never_good() -> None:
    case = clean()
    for observed, word in ((1.1e-4, "good"), (1.3e-4, "doubtful")):
        prediction = prediction_check(observed, 1e-4, 1.2e-4)
        found = verdict(case.found, case.validation, GATE, goodness=case.goodness, prediction=prediction)
        assert found.word == word and found.prediction is prediction
    assert "0.13 mm, but 0.1 mm was predicted for them" in in_one_line(found.reasons)
    assert found.accuracy.standing == "doubtful"


def test_errors_at_the_validation_poses_do_not_change_what_is_known_over_the_region() -> None:
    """One calibration, validated on poses that are a third as far off, and a tenth: as determined as before."""
    case = campaign(known=False)
    found = [
        verdict(case.found, Validation("holdout", errors(SPREAD, size * 0.01 * SPREAD)), poses=case.poses).determination
        for size in (1.0, 0.3, 0.1, 1e-3)
    ]
    assert {each.standing for each in found} == {"holds"} and len({in_one_line(each.checks) for each in found}) == 1
