"""A calibrated arm in the formats that other tools read."""

from lab.frames import Array
from lab.geometry.serial import SerialArm
from lab.geometry.table import write_table
from lab.output.urdf import calibrated_urdf
from lab.study.robots import Robot
from lab.virtual.placement import calibrated_mjcf

MJCF, URDF, TABLE = "calibrated.xml", "calibrated.urdf", "calibrated.toml"


def arm_files(robot: Robot, arm: SerialArm, values: Array) -> dict[str, str]:
    """Texts by their files' names: MJCF, URDF, and the table, which is exact to the bit.

    Args:
        values: parameters ``(p,)`` of the arm, base included, in the instrument's frame.
    """
    return {
        MJCF: calibrated_mjcf(robot.model, arm, values),
        URDF: calibrated_urdf(robot, arm, values),
        TABLE: table_text(arm, values),
    }


def table_text(arm: SerialArm, values: Array) -> str:
    """An arm with parameters ``(p,)`` as a table, exact to the bit, with its base and its targets."""
    base, table, tool = arm.split(values)
    return write_table(arm.chain.with_table(table), base, dict(zip(arm.targets, tool, strict=True)))
