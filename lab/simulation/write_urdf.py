"""An identified arm as URDF: of a robot that was given as a URDF that very file, with the identified origins."""

from lab.core import se3
from lab.core.limits import TEXT_BYTES
from lab.core.se3 import Array
from lab.formats.description import DescriptionFormat, IdentifiedRobot
from lab.formats.link_tree import last_axis_frame
from lab.formats.text_file import read_text
from lab.formats.urdf import identified_urdf
from lab.formats.urdf_patch import is_from_xacro, with_origins, xacro_properties
from lab.formats.urdf_source import is_urdf
from lab.kinematics.serial.arm import SerialArm
from lab.simulation.model import at_zero, body_pose, joint_name
from lab.simulation.serial_model import SerialModel

__all__ = ["URDF", "XACRO"]


def _source(model: SerialModel) -> str:
    """The text of the URDF that the model was read from; "" where it was none."""
    return read_text(model.path, TEXT_BYTES) if model.path.is_file() and is_urdf(model.path) else ""


def _origins(identified: IdentifiedRobot[SerialArm, SerialModel]) -> dict[str, Array]:
    """Poses ``(4, 4)`` (m) of the joints' frames in their parents', with the identified axes.

    A joint's frame is its nominal one, turned by the smallest rotation that aligns its axis and shifted across it. The
    last one goes along with the frame on the last joint's axis, as all formats have it; what the last frame moves
    beyond that axis is the tool's, which is not in the file.
    """
    model = identified.model
    moved, last = list(model.moved_bodies(identified.arm, identified.values)), model.model.body(model.bodies[-1]).id
    moved[last] = model.T_world_frame0 @ _moved_with_axis(identified) @ body_pose(at_zero(model.model), last)
    found = {}
    for name in model.bodies:
        body = model.model.body(name).id
        parent = int(model.model.body_parentid[body])
        found[joint_name(model.model, name)] = se3.inverse(moved[parent]) @ moved[body]
    return found


def _moved_with_axis(identified: IdentifiedRobot[SerialArm, SerialModel]) -> Array:
    """From the world to frame 0 after the frame on the last joint's axis has moved to its identified place, (4, 4)."""
    model, arm = identified.model, identified.arm
    identified_at, nominal_at = (last_axis_frame(arm, values) for values in (identified.values, arm.nominal()))
    return identified_at @ se3.inverse(model.T_world_frame0 @ nominal_at)


def _urdf(identified: IdentifiedRobot[SerialArm, SerialModel]) -> str:
    text = _source(identified.model)
    return with_origins(text, _origins(identified)) if text else identified_urdf(identified)


def _xacro(identified: IdentifiedRobot[SerialArm, SerialModel]) -> str:
    """The origins as properties of xacro; "" where the URDF was not made from one."""
    return xacro_properties(_origins(identified)) if is_from_xacro(_source(identified.model)) else ""


URDF: DescriptionFormat[SerialArm, SerialModel] = DescriptionFormat("calibrated.urdf", _urdf)
XACRO: DescriptionFormat[SerialArm, SerialModel] = DescriptionFormat("calibrated_origins.xacro", _xacro)
