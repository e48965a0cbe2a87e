"""URDFs from elsewhere: meshes of every kind wherever they are, grippers, bases that touch the first link."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from lab.core.errors import LabError
from lab.formats.urdf import is_urdf, read_urdf, stl_of_collada
from lab.robots.load_robot import load_robot, load_virtual

BOX = trimesh.creation.box((0.06, 0.08, 0.30))


def urdf(mesh: str, more: str = "", kind: str = "collision") -> str:
    """Three links about z, y, y, with the mesh on the last one."""

    def link(name: str, shape: str) -> str:
        return f'<link name="{name}"><{kind}><geometry>{shape}</geometry></{kind}></link>'

    def joint(name: str, parent: str, child: str, z: float, axis: str) -> str:
        return (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 0 {z}"/><axis xyz="{axis}"/><limit lower="-1.5" upper="1.5" velocity="2"/></joint>'
        )

    return (
        '<robot name="wild">'
        + link("base_link", '<cylinder radius="0.09" length="0.3"/>')
        + link("shoulder", '<box size="0.1 0.1 0.3"/>')
        + link("upper", f'<mesh filename="{mesh}" scale="1 1 1"/>')
        + link("fore", '<box size="0.04 0.04 0.1"/>')
        + joint("j1", "base_link", "shoulder", 0.1, "0 0 1")
        + joint("j2", "shoulder", "upper", 0.35, "0 1 0")
        + joint("j3", "upper", "fore", 0.35, "0 1 0")
        + more
        + "</robot>"
    )


def written(tmp_path: Path, mesh: str, content: bytes, **options: str) -> Path:
    """A package with the mesh and a URDF two folders down, as ROS has them."""
    package = tmp_path / "wild_description"
    (package / "meshes").mkdir(parents=True, exist_ok=True)
    (package / "urdf").mkdir(exist_ok=True)
    (package / "meshes" / mesh).write_bytes(content)
    path = package / "urdf" / "wild.urdf"
    path.write_text(urdf(f"package://wild_description/meshes/{mesh}", **options))
    return path


def exported(kind: str) -> bytes:
    content = BOX.export(file_type=kind)
    return content.encode() if isinstance(content, str) else content


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", pytest.param("dae", marks=pytest.mark.thorough)])
def test_a_mesh_of_any_kind_is_the_box_that_it_holds(kind: str, tmp_path: Path) -> None:
    """Written by another library; its extent is what MuJoCo then has."""
    path = written(tmp_path, f"box.{kind.removesuffix('_ascii')}", exported(kind))
    model = load_robot(str(path)).model.model
    meshes = [g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH]
    assert len(meshes) == 1 and model.nmesh == 1
    vertices = model.mesh_vert[: model.mesh_vertnum[0]]
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.geom_quat[meshes[0]])
    extent = np.ptp(vertices @ R.reshape(3, 3).T, axis=0)
    np.testing.assert_allclose(extent, BOX.extents, atol=1e-6)


SCENE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset><unit meter="0.001"/></asset>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="12">0 0 0 100 0 0 100 50 0 0 50 0</float_array>
<technique_common><accessor source="#a" count="4" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="1"/><input semantic="NORMAL" source="#n" offset="0"/>
<vcount>4</vcount><p>9 0 9 1 9 2 9 3</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene><node><translate>0 0 10</translate><rotate>0 0 1 90</rotate>
<node><scale>2 1 1</scale><instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes>
</COLLADA>"""


def test_a_collada_scene_is_scaled_and_placed() -> None:
    """A rectangle of 100 by 50 mm, doubled along x, turned to y, lifted by 10 mm: two triangles."""
    stl = stl_of_collada(Path("plate.dae"), SCENE.encode())
    read = trimesh.load(trimesh.util.wrap_as_stream(stl), file_type="stl")
    np.testing.assert_allclose(read.bounds, [[-0.05, 0.0, 0.01], [0.0, 0.2, 0.01]], atol=1e-7)
    assert len(read.faces) == 2 and read.area == pytest.approx(0.2 * 0.05)


def test_a_base_that_overlaps_the_first_link_is_left_out_and_said(tmp_path: Path) -> None:
    robot = load_virtual(str(written(tmp_path, "box.stl", exported("stl"))))
    assert robot.model.overlapping == (("base_link", "shoulder"),)
    assert any("base_link and shoulder touch by construction" in words for words in robot.warnings)
    model, data = robot.model.model, mujoco.MjData(robot.model.model)
    data.qpos[:] = [0.0, 0.0, 0.0]
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    data.qpos[:] = [0.0, 1.5, 1.5]
    mujoco.mj_forward(model, data)
    assert robot.model.base_body == "base_link" and robot.chain.joint_names == ("j1", "j2", "j3")


FINGERS = "".join(
    f'<link name="{name}"/><joint name="{name}_joint" type="prismatic"><parent link="fore"/><child link="{name}"/>'
    f'<origin xyz="0 0 0.05"/><axis xyz="0 1 0"/><limit lower="0" upper="0.04" velocity="1" effort="1"/>{mimic}</joint>'
    for name, mimic in (("left", ""), ("right", '<mimic joint="left_joint"/>'))
)


def test_a_grippers_joints_are_held_and_said(tmp_path: Path) -> None:
    path = written(tmp_path, "box.stl", exported("stl"), more=FINGERS)
    robot = load_robot(str(path))
    assert robot.chain.joint_names == ("j1", "j2", "j3")
    assert any("left_joint, right_joint are taken for a gripper's" in words for words in robot.warnings)


def test_shapes_for_looks_are_taken_where_there_are_no_others(tmp_path: Path) -> None:
    looks = load_robot(str(written(tmp_path, "box.stl", exported("stl"), kind="visual")))
    solid = load_robot(str(written(tmp_path, "box.stl", exported("stl"))))
    assert looks.model.model.ngeom == solid.model.model.ngeom == 4


def test_what_cannot_be_read_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, "box.stl", exported("stl"))
    assert is_urdf(path) and not read_urdf(path).missing
    (path.parent.parent / "meshes" / "box.stl").unlink()
    assert "mesh 'package://wild_description/meshes/box.stl' is missing" in read_urdf(path).missing
    assert "meshes are left out" in load_robot(str(path)).model.missing
    (path.parent.parent / "meshes" / "box.stl").write_bytes(b"solid x\nvertex 1 2\nendsolid")
    assert "not a readable STL" in read_urdf(path).missing
    path.write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="x"/></robot>')
    with pytest.raises(LabError, match="is a xacro that is not expanded"):
        read_urdf(path)
    path.write_text('<!DOCTYPE a [<!ENTITY b "c">]><robot/>')
    with pytest.raises(LabError, match="declares entities"):
        read_urdf(path)
    for part in ("parent", "child"):
        path.write_text(urdf("box.stl").replace(f'<{part} link="upper"/>', f"<{part}/>"))
        with pytest.raises(LabError, match=f"names no {part} link; give it a <{part}"):
            read_urdf(path)
    for part, words in (("parent", "is upper meant?"), ("child", "is upper meant?")):
        path.write_text(urdf("box.stl").replace(f'<{part} link="upper"/>', f'<{part} link="uper"/>'))
        with pytest.raises(LabError, match=rf"its {part} link 'uper' is not in the file; {re.escape(words)}"):
            read_urdf(path)
    path.write_text("<robot>")
    with pytest.raises(LabError, match="not a readable MJCF or URDF"):
        read_urdf(path)
    with pytest.raises(LabError, match="not a COLLADA file"):
        stl_of_collada(path, b"<a")
    with pytest.raises(LabError, match="has no triangle"):
        stl_of_collada(path, b"<a/>")
