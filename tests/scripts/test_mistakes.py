"""Mistakes that a diagnosis is measured with are as large as they say, and spoil what they name and nothing else."""

import diagnosis_study
import mistakes
import numpy as np
import pytest

import lab

ACCURACY_M = 5e-5
TIMES = [name for name, kind in mistakes.kinds_for(3).items() if kind.unit == "times"]


@pytest.fixture(scope="module")
def session() -> mistakes.Session:
    day = lab.simulate("irb120", poses=30, seed=5, targets=("p1", "p2", "p3"), instrument="leica-at960")
    return mistakes.session_of(day, ACCURACY_M)


def made(session: mistakes.Session, name: str, size: float, seed: int = 0) -> mistakes.Mistaken:
    return mistakes.KINDS[name].make(session, size, np.random.default_rng(seed))


@pytest.mark.parametrize("name", TIMES)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_continuous_mistake_displaces_the_points_that_it_spoils_by_its_size(session, name, seed) -> None:
    wrong = made(session, name, 10, seed)
    points = wrong.data.points - session.data.points - session.moved_by(wrong.data.joints - session.data.joints)
    squares = (points**2).sum(axis=-1)
    rms_m = np.sqrt(squares[squares > 1e-20].mean())
    assert np.isclose(rms_m, 10 * ACCURACY_M, rtol=2e-2)  # a joint's points move along an arc
    assert np.isclose(wrong.rms_m, rms_m, rtol=1e-6)


def test_a_calibration_of_the_geometry_leaves_no_more_of_a_mistake_than_there_is_and_nothing_of_a_scale(
    session,
) -> None:
    for name in TIMES:
        wrong = made(session, name, 10)
        assert 0 < mistakes.visible_m(session, wrong) < wrong.rms_m
    for seed in range(6):  # lengths and twists
        wrong = made(session, "link", 1, seed)
        assert mistakes.visible_m(session, wrong) < 1e-2 * wrong.rms_m
    wrong = made(session, "scale", 0.01)
    assert mistakes.visible_m(session, wrong) < 1e-6 < 1e-3 < wrong.rms_m  # the links and the base take it whole


def test_a_range_constant_lies_along_the_line_of_sight_and_a_step_after_its_row(session) -> None:
    points = session.data.points
    wrong = made(session, "range_constant", 10)
    longer = np.linalg.norm(wrong.data.points, axis=-1) - np.linalg.norm(points, axis=-1)
    assert np.allclose(np.abs(longer), wrong.number) and np.allclose(np.cross(wrong.data.points, points), 0, atol=1e-12)
    step = made(session, "target_step", 10)
    moved = np.linalg.norm(step.data.points - points, axis=-1)
    first = session.data.ids.index(step.of[2])
    of = session.data.targets.index(step.of[0])
    assert np.allclose(moved[first:, of], step.number) and not moved[:first].any() and not np.delete(moved, of, 1).any()


def test_mistakes_of_rows_leave_what_was_measured(session) -> None:
    shifted = made(session, "rows_shifted", 1).data
    assert len(shifted) == len(session.data) - 1
    assert np.array_equal(shifted.points, session.data.points[1:])
    assert np.array_equal(shifted.joints, session.data.joints[:-1])
    exchanged = made(session, "rows_exchanged", 2)
    changed = (exchanged.data.joints != session.data.joints).any(axis=1)
    assert {session.data.ids[row] for row in np.flatnonzero(changed)} == set(exchanged.of)
    assert np.array_equal(np.sort(exchanged.data.joints, axis=0), np.sort(session.data.joints, axis=0))
    once = made(session, "targets_exchanged_once", 1)
    assert (once.data.points != session.data.points).any(axis=(1, 2)).sum() == 1
    assert np.array_equal(np.sort(once.data.points, axis=1), np.sort(session.data.points, axis=1))


def test_the_first_finding_decides_how_a_campaign_went() -> None:
    def row(*found: str, **more: object) -> dict[str, object]:
        return {"made": ["base_step"], "targets": 3, "found": [{"name": name, "rivals": []} for name in found], **more}

    went = [row("base_step", "drift"), row("drift", "base_step"), row("drift"), row(), row(refused="no end")]
    assert [diagnosis_study.named(each) for each in went] == ["first", "later", "another", "missed", "refused"]
    assert diagnosis_study.covers(1e-4, {"sizes": (-0.9e-4,), "stds": (0.1e-4,)})
    assert not diagnosis_study.covers(1e-4, {"sizes": (0.7e-4,), "stds": (0.1e-4,)})
    assert diagnosis_study.covers(float("nan"), {"sizes": (1.0,), "stds": (0.1,)}) is None
