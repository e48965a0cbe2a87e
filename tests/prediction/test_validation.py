"""The assessment: splits, folds, sessions, and the verdict."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, perturbed, somewhere

from lab.calibration.identification import Identification, identify
from lab.calibration.row_groups import configurations, folds, hold_out_last, rows_in_time, split_by_label
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.kinematics.effects.arm_with_effects import affected
from lab.kinematics.effects.backlash import backlash
from lab.kinematics.serial.serial_arm import SerialArm
from lab.phrases.phrase import phrases
from lab.prediction.validation import validate_file, validate_folds
from lab.verdict.verdict import verdict

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names


def campaign(poses: int, seed: int, noise: float = 5e-6) -> tuple[Measurements, np.ndarray]:
    rng = np.random.default_rng(seed)
    true = perturbed(ARM, somewhere(ARM, rng), rng, 0.5e-3, 1.5e-3)
    joints = IRB120.chain.random_joints(poses, rng)
    points = ARM.points(joints, true) + noise * rng.normal(size=(poses, 1, 3))
    return measured(NAMES, joints, ("p1",), points), true


def fitted(data: Measurements):
    return identify(ARM, data, ARM.nominal())


def test_configurations_are_grouped_transitively() -> None:
    """0, 8 and 16 mrad are one configuration through the middle one; 27 mrad is another."""
    joints = np.zeros((5, 6))
    joints[:, 1] = [0, 0.008, 0.016, 0.027, 1.0]
    assert configurations(joints).tolist() == [0, 0, 0, 1, 2]


def test_repeats_are_never_split() -> None:
    rng = np.random.default_rng(0)
    joints = np.repeat(rng.normal(size=(40, 6)), rng.integers(1, 6, 40), axis=0)
    joints += 1e-4 * rng.normal(size=joints.shape)
    for seed in range(20):
        labels = configurations(joints)
        fit_rows, test_rows = split_by_label(labels, 0.3, seed)
        assert sorted([*fit_rows, *test_rows]) == list(range(len(joints)))
        assert not set(labels[fit_rows]) & set(labels[test_rows])
        assert len(test_rows) / len(joints) == pytest.approx(0.3, abs=0.06)


def test_the_last_rows_are_held_out_with_nothing_of_their_configurations_fitted() -> None:
    """Of 60 rows the last 18; a pose that is measured again among them is in neither set, its first visit is fitted."""
    data, _ = campaign(60, 1)
    rows, test = hold_out_last(ARM, data, 0.3)
    assert rows.ids == data.ids[:42] and test.ids == data.ids[42:]
    again = np.arange(60)
    again[[45, 55]] = 3  # a reference pose
    again[50] = 49  # a repeat within the last part
    part, late = hold_out_last(ARM, data[again], 0.3)
    assert len(part) == 42 and len(late) == 16
    assert not set(map(tuple, part.joints)) & set(map(tuple, late.joints))


def test_the_last_rows_are_the_last_by_time_where_the_file_has_it() -> None:
    data, _ = campaign(10, 1)
    times = np.array([5.0, 1.0, 9.0, 2.0, 3.0, 8.0, 4.0, 0.0, 7.0, 6.0])
    timed = replace(data, conditions={"time_s": times})
    assert list(times[rows_in_time(timed)]) == sorted(times)
    rows, test = hold_out_last(ARM, timed, 0.3)
    assert set(test.conditions["time_s"]) == {7.0, 8.0, 9.0} and len(rows) == 7
    times[4] = np.nan  # half a column says no order
    assert rows_in_time(replace(data, conditions={"time_s": times})).tolist() == list(range(10))


@pytest.mark.parametrize(
    ("share", "words"), [(0.0, "between 0 and 1"), (1.0, "between 0 and 1"), (np.nan, "between 0 and 1"),
                         (1e-3, "too few to fit or to validate"), (0.999, "too few to fit or to validate")],
)  # fmt: skip
def test_a_share_of_last_rows_that_leaves_nothing_is_refused(share: float, words: str) -> None:
    with pytest.raises(LabError, match=words):
        hold_out_last(ARM, campaign(60, 1)[0], share)


def test_cycles_of_the_same_poses_have_no_last_rows_of_their_own() -> None:
    data, _ = campaign(10, 1)
    with pytest.raises(LabError, match="the last 9 rows are of configurations or fixtures that were measured before"):
        hold_out_last(ARM, data[np.tile(np.arange(10), 3)], 0.3)


def test_cross_validation_judges_every_row_once_and_delivers_from_all() -> None:
    data, _ = campaign(60, 2)
    whole = fitted(data)
    told: list[tuple[int, int]] = []
    validation = validate_folds(fitted, whole, data, 0, lambda done, of: told.append((done, of)))
    assert told == [(fold, 5) for fold in range(1, 6)]
    assert validation.judged_by == "cross-validation" and validation.errors is not None
    assert np.isfinite(validation.errors.after).all()
    residual = np.linalg.norm(whole.residuals, axis=2).mean()
    assert validation.errors.after.mean() > residual  # what was fitted looks better than what was not


@pytest.mark.parametrize(("poses", "judged"), [(17, False), (18, True)])
def test_folds_need_one_and_a_half_times_the_base_set(poses: int, judged: bool) -> None:
    """27 parameters: 40.5 coordinates, 14 poses, must stay in each fold; of 17, two folds hold out 4."""
    data, _ = campaign(poses, 3)
    validation = validate_folds(fitted, fitted(data), data, 0)
    assert (validation.errors is not None) == judged
    if not judged:
        assert validation.judged_by is None and validation.checks
        assert verdict(fitted(data), validation, 1e-3).word == "not judged"


@pytest.mark.parametrize(("labels", "count"), [(60, 5), (5, 5), (3, 3), (1, 1)])
def test_folds_keep_labels_whole_and_even(labels: int, count: int) -> None:
    rows = np.resize(np.arange(labels), 3 * labels)
    found = folds(rows, 0)
    assert sorted(set(found.tolist())) == list(range(count)) and found.shape == rows.shape
    sizes = [len(set(rows[found == fold].tolist())) for fold in range(count)]
    assert sum(sizes) == labels and max(sizes) - min(sizes) <= 1
    assert np.array_equal(found, folds(rows, 0)) and (labels < 5 or not np.array_equal(found, folds(rows, 1)))


def sessions(seed: int) -> tuple[Measurements, Measurements]:
    """A calibration, and two sessions of it in which base and target stand elsewhere."""
    data, true = campaign(60, seed)
    rng = np.random.default_rng(seed + 100)
    parts = []
    for _ in range(2):
        moved = true.copy()
        moved[:6] = somewhere(ARM, rng)[:6]
        moved[-3:] = 0.1 * rng.normal(size=3)
        joints = IRB120.chain.random_joints(30, rng)
        parts.append((joints, ARM.points(joints, moved) + 5e-6 * rng.normal(size=(30, 1, 3))))
    joints, points = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    other = measured(NAMES, joints, ("p1",), points)
    use = tuple("reference" if i % 30 < 10 else "test" for i in range(60))
    fields = {**other.__dict__, "sessions": ("a",) * 30 + ("b",) * 30, "use": use, "marked": True}
    return data, Measurements(**fields)


def test_sessions_are_placed_on_their_reference_rows_alone() -> None:
    data, other = sessions(4)
    found = fitted(data)
    validation = validate_file(found, ARM, other, ["base", "tool"])
    assert validation.judged_by == "file" and validation.errors is not None
    assert validation.errors.after.shape == (40, 1)
    assert validation.errors.after.mean() < 20e-6 < validation.errors.before.mean()
    unplaced = validate_file(found, ARM, other, [])
    assert unplaced.errors is not None and unplaced.errors.after.mean() > 0.1


def test_too_few_reference_rows_are_refused() -> None:
    data, other = sessions(6)
    use = tuple("reference" if i % 30 == 0 else "test" for i in range(60))
    one_each = Measurements(**{**other.__dict__, "use": use})
    with pytest.raises(LabError, match=r"session 'a'.*mark more rows"):
        validate_file(fitted(data), ARM, one_each, ["base", "tool"])


def test_a_condition_that_the_file_lacks_is_named() -> None:
    arm = affected(ARM, [backlash(IRB120.chain)])
    rng = np.random.default_rng(13)
    data, _ = campaign(80, 13)
    sides = {f"approach_{name}": rng.choice([-1.0, 1.0], 80) for name in NAMES}
    found = identify(arm, replace(data, conditions=sides), arm.nominal())
    assert validate_file(found, arm, replace(data, conditions=sides), []).errors is not None
    with pytest.raises(LabError, match=r"^column approach_q1 is missing: the model needs it in every row"):
        validate_file(found, arm, data, [])
    sides["approach_q3"][7] = np.nan
    with pytest.raises(LabError, match=r"^row 7, column approach_q3: empty"):
        validate_file(found, arm, replace(data, conditions=sides), [])


def test_folds_that_cannot_be_fitted_or_lose_the_only_target_validate_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, arm = np.random.default_rng(1), IRB120.arm(("p1",))
    joints = IRB120.chain.random_joints(40, rng)
    points = arm.points(joints, arm.nominal(IRB120.tool)) + 1e-5 * rng.standard_normal((40, 1, 3))
    rows = measured(IRB120.chain.joint_names, joints, ("p1",), points)
    found = identify(arm, rows, arm.nominal(IRB120.tool))
    tool = tuple(arm.names.index(f"tool.p1.{axis}") for axis in "xyz")

    def refused(part: Measurements) -> Identification:
        raise LabError(f"{len(part)} poses are too few")

    nothing = validate_folds(refused, found, rows, 0)
    assert nothing.errors is None and phrases(nothing.checks) == (
        "not validated: without a fold, 32 poses are too few",
    )
    monkeypatch.setattr(Identification, "unobservable", tool)
    nothing = validate_folds(lambda _: found, found, rows, 0)
    assert nothing.errors is None and "do not identify all parameters" in phrases(nothing.checks)[0]
