"""Small robots and what stands around them."""

from pathlib import Path

from helpers.robots import IRB120
from lab.simulation.load_model import load_model
from lab.simulation.robot_model import RobotModel

MODEL = IRB120.model


def small_arm(folder: Path, extra: str = "", on_hand: str = "", tracker: str = "2 0 0", stand: str = "") -> RobotModel:
    """Two links, 0.4 m about z and 0.36 m about y, 0.5 m above a floor; p1 at its tip looks out along it."""
    path = folder / "small.xml"
    stand = stand or '<geom type="cylinder" size=".1 .5" pos="0 0 .51"/>'
    path.write_text(
        '<mujoco><compiler angle="degree" autolimits="true"/><worldbody><geom type="plane" size="0 0 .1"/>'
        f'<body name="tracker" pos="{tracker}"><site name="tracker" pos="0 0 1"/>{stand}</body>{extra}'
        '<body name="base"><geom type="cylinder" size=".08 .2" pos="0 0 .21"/>'
        '<body name="link1" pos="0 0 .5"><joint name="q1" axis="0 0 1" range="-180 180"/>'
        '<geom type="capsule" size=".03" fromto="0 0 0 .4 0 0"/>'
        '<body name="link2" pos=".4 0 0"><joint name="q2" axis="0 1 0" range="-120 120"/>'
        '<geom type="capsule" size=".03" fromto="0 0 0 .3 0 0"/>'
        f'<site name="p1" pos=".36 0 0" zaxis="1 0 0"/>{on_hand}</body></body></body></worldbody></mujoco>'
    )
    return load_model(path)


def among_posts(folder: Path) -> RobotModel:
    """The IRB 120 in its scene with two posts as tall as its shoulder in reach of it."""
    source = MODEL.path.parent
    (folder / "robot.xml").write_text((source / "robot.xml").read_text())
    (folder / "assets").symlink_to(source / "assets")
    scene, world = (source / "scene.xml").read_text(), "<worldbody>"
    posts = (
        '<geom type="cylinder" size=".03 .25" pos=".35 .2 .25"/><geom type="box" size=".04 .02 .3" pos=".1 -.4 .3"/>'
    )
    (folder / "scene.xml").write_text(scene.replace(world, world + posts))
    return load_model(folder / "scene.xml")
