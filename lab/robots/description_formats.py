"""Name the formats in which each kind of robot is described.

The first of a kind is the one that a run keeps of a robot given as a model; the last, exact to the bit, that of a robot
given as a table or as a mechanism.
"""

from lab.formats.description import DescriptionFormat
from lab.formats.mechanism_toml import MECHANISM_TOML
from lab.formats.robot_toml import TABLE_TOML
from lab.formats.ur_calibration import UR_CORRECTIONS, UR_KINEMATICS
from lab.kinematics.closed.closed_arm import ClosedArm
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.tree import TreeArm
from lab.simulation.closed_robot import CLOSED_MJCF, ClosedModel
from lab.simulation.load_model import MJCF, TREE_MJCF, URDF, XACRO
from lab.simulation.robot_model import SerialModel, TreeModel

__all__ = ["CLOSED_FORMATS", "MAKER_FORMATS", "SERIAL_FORMATS", "TREE_FORMATS"]

MAKER_FORMATS: tuple[DescriptionFormat[SerialArm, SerialModel], ...] = (UR_KINEMATICS, UR_CORRECTIONS)
SERIAL_FORMATS: tuple[DescriptionFormat[SerialArm, SerialModel], ...] = (MJCF, URDF, XACRO, *MAKER_FORMATS, TABLE_TOML)
CLOSED_FORMATS: tuple[DescriptionFormat[ClosedArm, ClosedModel], ...] = (CLOSED_MJCF, MECHANISM_TOML)
TREE_FORMATS: tuple[DescriptionFormat[TreeArm, TreeModel], ...] = (TREE_MJCF,)
