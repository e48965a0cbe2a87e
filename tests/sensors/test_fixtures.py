"""Cables, sockets and planes: derivatives, ranks, exact recovery, fixtures that were not fitted."""

import numpy as np
import pytest
from helpers.fixture_data import many, measured_fixtures, true_values
from helpers.observed_files import HEADER, read
from helpers.robots import IRB120, assert_derivatives

from lab.calibration.identification import identify
from lab.core.errors import LabError
from lab.core.measurements import FIXTURE
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.library.identify import identify as identify_file
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.option_groups import Fitting
from lab.phrases.phrase import in_one_line
from lab.prediction.validation import errors_of
from lab.sensors.cable import Cable
from lab.sensors.fixtures import Fixtures
from lab.sensors.plane import Planes
from lab.sensors.sensor_registry import sensor_named
from lab.sensors.socket import Sockets, SocketSensor

ARM = SerialArm(IRB120.chain)
KINDS: dict[str, type[Fixtures]] = {"cable": Cable, "socket": Sockets, "plane": Planes}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_derivatives_at_fixtures(kind) -> None:
    rng = np.random.default_rng(0)
    observation = many(kind, 3)
    true = true_values(observation, rng)
    inputs = np.column_stack([IRB120.chain.random_joints(7, rng), [0, 1, 2, 2, 0, 1, 0]])
    observed, jacobian = observation.observe(inputs, true)
    np.testing.assert_array_equal(observed, observation.points(inputs, true))
    assert_derivatives(lambda values: observation.points(inputs, values), jacobian, true)


RANKS = {
    ("cable", 1, None): 21 + 3 + 1,  # 27 of a point less the base, which the anchor is; an offset
    ("cable", 3, None): 21 + 9 + 1,
    ("socket", 2, None): 21 + 6 - 1,  # the scale is not seen
    ("socket", 2, 0.05): 21 + 6,
    ("socket", 4, 0.05): 21 + 12,
    ("plane", 3, None): 21 + 9 - 1,
}


@pytest.mark.parametrize(("kind", "places", "distance"), RANKS)
def test_ranks_at_fixtures(kind: str, places: int, distance: float | None) -> None:
    more = {} if distance is None else {"distance_m": distance}
    observation = many(KINDS[kind], places, **more)
    values = true_values(observation, np.random.default_rng(0))
    structure = base_set(observation, values, prior_rows=observation.extra_residuals(observation.rank_point(values))[1])
    assert len(structure.identifiable) == RANKS[kind, places, distance]
    fixed = {observation.names[i] for i in structure.fixed}
    assert {f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")} <= fixed
    assert ("link4.d" in fixed) == (kind != "cable" and distance is None)  # 302 mm: the longest link is the scale


def test_structure_poses_touch() -> None:
    for kind in (Sockets, Planes):
        observation = many(kind, 4)
        inputs = observation.structure_joints(60, np.random.default_rng(0))
        values = observation.rank_point(observation.nominal(observation.nominal_arm))
        assert inputs.shape == (60, 7) and np.abs(observation.points(inputs, values)).max() < 1e-11
        assert set(inputs[:, -1]) == {0, 1, 2, 3}


@pytest.mark.parametrize(("kind", "places", "rows"), [(Cable, 2, 80), (Sockets, 4, 60), (Planes, 3, 120)])
def test_exact_fixtures_give_the_truth(kind, places: int, rows: int) -> None:
    rng = np.random.default_rng(0)
    observation = many(kind, places)
    data, true = measured_fixtures(observation, rows, rng)
    found = identify(observation, data, ARM.nominal())
    assert found.status == "converged" and not found.unobservable and found.plausible
    assert np.abs(found.values - true).max() < 1e-11


@pytest.mark.thorough
def test_fixtures_that_were_not_fitted_are_placed_by_their_own_rows() -> None:
    for kind in (Sockets, Planes, Cable):
        rng = np.random.default_rng(0)
        observation = many(kind, 6)
        data, _ = measured_fixtures(observation, 120, rng)
        known = data.conditions[FIXTURE] < 4
        found = identify(observation, data[known], ARM.nominal())
        assert len(found.model.numbers) == 4 and len(found.values) == len(observation.names) - 6
        errors = errors_of(found, data)
        assert errors.after.shape == (120, 1) and np.nanmax(errors.after) < 1e-7
        assert np.nanmean(errors.before) > 1e-4


def test_a_fixture_of_a_few_rows_is_not_judged_by_itself() -> None:
    """One ball in a socket sits exactly in the mean of itself: that says nothing."""
    observation = many(Sockets, 6)
    data, _ = measured_fixtures(observation, 60, np.random.default_rng(0))
    place = data.conditions[FIXTURE]
    found = identify(observation, data[place < 4], ARM.nominal())
    rest = data[[*np.flatnonzero(place == 4)[:3], *np.flatnonzero(place == 5)]]
    errors = errors_of(found, rest).after
    assert np.isnan(errors[:3]).all() and np.isfinite(errors[3:]).all()


NONSENSE = {
    "three planes": ("plane", "location", lambda i: "abc"[i % 3]),
    "six sockets": ("socket", "location,socket", lambda i: f"{i % 6 // 2},{i % 2}"),
    "a wire of one length": ("cable", "cable_mm", lambda i: "500"),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "columns", "cell"), NONSENSE.values(), ids=NONSENSE)
def test_random_poses_are_at_no_fixture(kind, columns, cell, tmp_path) -> None:
    """Arm and places shrink together until all residuals are zero: that is no calibration."""
    joints = np.rad2deg(IRB120.chain.random_joints(60, np.random.default_rng(0)))
    rows = "".join(f"{','.join(map(str, row))},{cell(i)}\n" for i, row in enumerate(joints))
    path = tmp_path / "m.csv"
    path.write_text(f"{HEADER},{columns}\n{rows}")
    words = (
        "the measured values are the same in every pose" if kind == "cable" else "the readings do not determine link"
    )
    outcome = identify_file(MeasuredCampaign(path, observe=kind, fitting=Fitting(prior=False)))
    assert outcome.verdict.word == "bad" and words in in_one_line(outcome.verdict.reasons)
    assert np.nanmax(np.abs(outcome.identification.residuals)) < 1e-3  # it fits, and says nothing


BLANKS = {
    "location of a plane": ("plane", "location", ["a", "", "a", "a", "a"], r"line 3, column location: empty; .*plane"),
    "session of a plane": ("plane", "session", ["1", "1", "1", "1", ""], r"line 6, column session: empty; .*plane"),
    "location of a socket": (
        "socket",
        "location,socket",
        ["a,0", "a,1", ",0", "a,0", "a,1"],
        "line 4, column location",
    ),
    "socket": ("socket", "location,socket", ["a,", "a,1", "a,0", "a,0", "a,1"], "line 2, column socket: empty"),
    "every location": ("socket", "location,socket", [",0"] * 5, "line 2, column location: empty"),
    "session of a wire": ("cable", "session,cable_mm", ["1,300", ",300", *["1,300"] * 3], "line 3, column session"),
}


@pytest.mark.parametrize(("kind", "columns", "rows", "what"), BLANKS.values(), ids=BLANKS)
def test_a_row_says_which_fixture_it_is_of(kind, columns, rows, what, tmp_path) -> None:
    lines = "".join(f"{i},2,3,4,5,6,{row}\n" for i, row in enumerate(rows))
    data = read(tmp_path, f"{HEADER},{columns}\n{lines}", kind)
    with pytest.raises(LabError, match=what):
        sensor_named(kind)().observation(ARM, data, ARM.nominal())


ALL_NAMED = {
    "one plane": ("plane", "note", ["n"] * 5, ("",)),
    "one plane, with empty columns": ("plane", "session,location", [","] * 5, ("",)),
    "a row to skip": ("plane", "location,use", [*["a,calibrate"] * 4, ",skip"], ("a",)),
    "a wire of one session": ("cable", "session,cable_mm", [",300"] * 5, ("",)),
    "a row without a length": ("cable", "session,cable_mm", [*["a,300"] * 4, ","], ("a",)),
}


@pytest.mark.parametrize(("kind", "columns", "rows", "labels"), ALL_NAMED.values(), ids=ALL_NAMED)
def test_what_needs_no_fixture_may_have_none(kind, columns, rows, labels, tmp_path) -> None:
    lines = "".join(f"{i},2,3,4,5,6,{row}\n" for i, row in enumerate(rows))
    data = read(tmp_path, f"{HEADER},{columns}\n{lines}", kind)
    assert sensor_named(kind)().observation(ARM, data, ARM.nominal())[0].labels == labels


def test_few_rows_are_left_out_and_told(tmp_path) -> None:
    rows = "".join(f"{i},2,3,4,5,6,a,{i % 2}\n" for i in range(6)) + "1,1,1,1,1,1,b,0\n"
    data = read(tmp_path, f"{HEADER},location,socket\n{rows}", "socket")
    observation, seen = SocketSensor().observation(ARM, data, ARM.nominal())
    assert isinstance(observation, Sockets) and observation.labels == ("a.0", "a.1") and len(seen) == 6
    assert any("socket b.0 has 1 of the 2 rows" in warning for warning in seen.warnings)
    three = read(
        tmp_path, f"{HEADER},location,socket\n" + "".join(f"{i},2,3,4,5,6,a,{i % 3}\n" for i in range(6)), "socket"
    )
    with pytest.raises(LabError, match="location a has 3 sockets"):
        SocketSensor(0.05).observation(ARM, three, ARM.nominal())
