"""Z and E of a run, beside its own base and tool."""

import numpy as np
import pytest
from helpers.campaigns import calibration

import lab
from lab.core import se3
from lab.kinematics.serial.khalil_frames import SYMBOLS, khalil_frame, pose_of
from lab.library.khalil_rows import khalil_rows


@pytest.fixture(scope="module")
def posed() -> lab.CalibrationResult:
    return calibration("rx130", observe="pose", poses=40, seed=4, instrument="leica-at960")


def test_the_twelve_are_the_base_and_the_tool(posed: lab.CalibrationResult) -> None:
    found = posed.identification
    rows = {row["name"]: row for row in khalil_rows(posed.estimate, float(found.half_width_95.max()))}
    assert list(rows) == [f"{owner}.{symbol}" for owner in ("Z", "E.p1") for symbol in SYMBOLS]
    values = dict(zip(found.model.names, found.values, strict=True))
    for owner, names in (("Z", ("base.{}", "base.r{}")), ("E.p1", ("tool.p1.{}", "tool.r{}"))):
        place, turn = (np.array([values[name.format(axis)] for axis in "xyz"]) for name in names)
        six = np.array([rows[f"{owner}.{symbol}"]["estimate"] for symbol in SYMBOLS])
        np.testing.assert_allclose(pose_of(six), se3.pose(se3.exp(turn), place), atol=1e-12)


def test_intervals_are_those_of_many_draws(posed: lab.CalibrationResult) -> None:
    """The spread of Z over bases that are drawn from the covariance of the base: another way than derivatives."""
    found = posed.identification
    rows = {row["name"]: row for row in khalil_rows(posed.estimate, float(found.half_width_95.max()))}
    base = [found.model.names.index(f"base.{axis}") for axis in ("x", "y", "z", "rx", "ry", "rz")]
    at = [found.fit.free.index(i) for i in base]
    draws = np.random.default_rng(0).multivariate_normal(found.values[base], found.covariance[np.ix_(at, at)], 4000)
    spread = np.std([khalil_frame(se3.pose(se3.exp(each[3:]), each[:3])).values for each in draws], axis=0)
    if not rows["Z.gamma"].get("note"):
        np.testing.assert_allclose([rows[f"Z.{symbol}"]["std"] for symbol in SYMBOLS], spread, rtol=0.06)
    assert ("note" in rows["Z.r"]) == (rows["Z.r"]["std"] is None) == (rows["Z.r"]["interval_95"] is None)
