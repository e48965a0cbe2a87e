"""A calibrated arm in the formats that other tools read."""

from lab.campaign.robot import Robot
from lab.core.se3 import Array
from lab.formats.dh_table_toml import write_table
from lab.formats.mechanism_toml import write_mechanism
from lab.formats.urdf import calibrated_urdf
from lab.kinematics.closed.arm import ClosedArm
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.arm import SerialArm
from lab.simulation.closed_robot import identified_mjcf
from lab.simulation.write_mjcf import calibrated_mjcf

MJCF, URDF, TABLE = "calibrated.xml", "calibrated.urdf", "calibrated.toml"


def arm_files(robot: Robot, arm: RigidArm, values: Array) -> dict[str, str]:
    """Texts by their files' names: MJCF, URDF (a tree, so of a chain alone), and the TOML, which is exact to the bit.

    Args:
        values: parameters ``(p,)`` of the arm, base included, in the instrument's frame.
    """
    if isinstance(arm, ClosedArm):
        return {MJCF: identified_mjcf(robot.model, arm, values), TABLE: table_text(arm, values)}
    assert isinstance(arm, SerialArm)
    return {
        MJCF: calibrated_mjcf(robot.serial_model, arm, values),
        URDF: calibrated_urdf(robot, arm, values),
        TABLE: table_text(arm, values),
    }


def table_text(arm: RigidArm, values: Array) -> str:
    """An arm with parameters ``(p,)`` as TOML, exact to the bit, with its base and its targets."""
    if isinstance(arm, ClosedArm):
        return write_mechanism(arm.chain, values, arm.places(values))
    assert isinstance(arm, SerialArm)
    base, table, tool = arm.split(values)
    return write_table(arm.chain.with_table(table), base, dict(zip(arm.targets, tool, strict=True)))
