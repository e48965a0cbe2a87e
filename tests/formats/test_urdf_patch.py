"""Origins of joints replaced in a URDF's own text."""

import numpy as np
import pytest

from lab.core import se3
from lab.core.errors import LabError
from lab.formats.urdf import is_from_xacro, with_origins, xacro_properties

TEXT = """<robot name='r'>  <!-- <joint name="a"><parent/><origin xyz="9 9 9"/></joint> -->
  <joint type="revolute" name='a'><parent link="w"/>
    <origin  xyz="0 0 1"
             rpy="0 0 0"></origin><child link="v"/></joint>
  <joint name="b" type="fixed"><parent link="v"/><child link="u"/></joint>
  <transmission><joint name="a"><hardwareInterface>x</hardwareInterface></joint></transmission>
</robot>
"""
T = se3.pose(se3.exp(np.array([0.0, 0.0, 0.5])), np.array([0.1, -0.2, 0.3]))
ORIGIN = '<origin xyz="0.1 -0.2 0.3" rpy="0.0 0.0 0.5"/>'


def test_only_the_origin_of_the_joint_changes() -> None:
    old = TEXT[TEXT.index("<origin  xyz") : TEXT.index("</origin>") + len("</origin>")]
    assert with_origins(TEXT, {"a": T}) == TEXT.replace(old, ORIGIN)
    assert with_origins(TEXT, {}) == TEXT


def test_a_joint_without_an_origin_gets_one() -> None:
    assert with_origins(TEXT, {"b": T}) == TEXT.replace('type="fixed">', f'type="fixed">{ORIGIN}')


def test_a_joint_that_is_not_there_is_told() -> None:
    with pytest.raises(LabError, match="joint c is not in the URDF"):
        with_origins(TEXT, {"a": T, "c": T})


def test_properties_for_xacro() -> None:
    assert '<xacro:property name="a_1_xyz" value="0.1 -0.2 0.3"/>' in xacro_properties({"a-1": T})
    assert not is_from_xacro(TEXT)
