"""Units that a person reads parameters in."""

import numpy as np
from helpers.robots import IRB120

from lab.render.document import display_unit


def test_every_parameter_of_an_arm_has_a_unit() -> None:
    arm = IRB120.arm_with(("p1",), ("compliance", "gear"))
    units = {each.name: display_unit(each) for each in arm.parameters}
    assert units["base.x"].name == "mm" and units["base.x"].factor == 1e3
    assert units["base.rx"].factor == 180 / np.pi and units["joint2.compliance"].name == "µrad/Nm"
    assert all(unit.factor > 0 and unit.digits > 0 for unit in units.values())
