"""Arms over months, in small: a zero that moves is found, an arm that stays is left alone."""

from pathlib import Path

import numpy as np
import pytest
from operations_year import Arm, Options, arms_of, lived

import lab


def test_what_happens_to_an_arm_begins_in_its_month() -> None:
    options = Options()
    kinds = [each.kind for each in arms_of(options)]
    assert kinds.count("stable") == 6 and {*kinds} == {"stable", "zero", "crash", "wear"}
    for kind in ("zero", "crash", "wear"):
        arm = Arm("A", kind, 5)
        assert not arm.off(4, options).any() and arm.off(5, options).any()
    wear = Arm("A", "wear", 5)
    assert np.isclose(wear.off(9, options)[1], 5 * wear.off(5, options)[1])
    assert np.abs(Arm("A", "crash", 1).off(3, options)).max() == options.crash_mrad / 1e3


@pytest.mark.thorough
def test_a_moved_zero_is_found_and_mended(tmp_path: Path) -> None:
    options = Options(months=3)
    moved, still = (lived(Arm(name, kind, 2), tmp_path, options, i) for i, (name, kind) in
                    enumerate((("A-1", "zero"), ("A-2", "stable"))))  # fmt: skip
    assert moved.found == 0 and moved.size_mrad == pytest.approx(0.15) and moved.calibrations == 2
    assert moved.false_alarms == still.false_alarms == 0 and moved.checks == 2
    assert not list(tmp_path.rglob("recording.rrd"))
    shown = {arm.serial: arm for arm in lab.history(tmp_path, on="2024-03-10").arms}  # before it is mended
    assert {name: arm.state for name, arm in shown.items()} == {"A-1": "bad", "A-2": "good"}
    after = {arm.serial: arm for arm in lab.history(tmp_path, on="2024-04-10").arms}
    assert {arm.state for arm in after.values()} == {"good"}
