"""Work that takes long tells how much of it is done, in one way, and nobody by default."""

import numpy as np
import pytest
from helpers.robots import IRB120, somewhere

from lab.compensation.compensator import Compensator
from lab.core import progress
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.inverse.newton import PoseTarget


def test_parts_are_told_as_they_are_done_up_to_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lab.compensation.compensator._BLOCK", 2)
    arm = IRB120.serial_arm(("p1",))
    values = somewhere(arm, np.random.default_rng(0))
    joints = 0.3 * arm.chain.random_joints(5, np.random.default_rng(1))
    Ts, _ = arm.tool(joints, values)
    wanted, told = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), list[tuple[int, int]]()
    for teller in (progress.no_progress, lambda done, of: told.append((done, of))):
        Compensator(NominalInverse(arm, values), arm, values, progress=teller)(wanted, np.empty((5, 0)), joints)
    assert told == [(2, 5), (4, 5), (5, 5)]
