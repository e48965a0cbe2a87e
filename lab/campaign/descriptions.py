"""The file formats in which each kind of robot can be described: a line adds one.

The first format of a kind is the one that a run keeps of a robot that was given as a model; the last one is exact to
the bit, which a run keeps of a robot that was given as a table or as a mechanism.
"""

from lab.formats.description import DescriptionFormat
from lab.formats.dh_table_toml import TABLE_TOML
from lab.formats.mechanism_toml import MECHANISM_TOML
from lab.formats.ur_calibration import UR_CORRECTIONS, UR_KINEMATICS
from lab.kinematics.closed.arm import ClosedArm
from lab.kinematics.serial.arm import SerialArm
from lab.simulation.closed_robot import CLOSED_MJCF, ClosedModel
from lab.simulation.serial_model import SerialModel
from lab.simulation.write_mjcf import MJCF
from lab.simulation.write_urdf import URDF, XACRO

__all__ = ["CLOSED_FORMATS", "MAKER_FORMATS", "SERIAL_FORMATS"]

MAKER_FORMATS: tuple[DescriptionFormat[SerialArm, SerialModel], ...] = (UR_KINEMATICS, UR_CORRECTIONS)
SERIAL_FORMATS: tuple[DescriptionFormat[SerialArm, SerialModel], ...] = (
    MJCF,
    URDF,
    XACRO,
    *MAKER_FORMATS,
    TABLE_TOML,
)
CLOSED_FORMATS: tuple[DescriptionFormat[ClosedArm, ClosedModel], ...] = (CLOSED_MJCF, MECHANISM_TOML)
