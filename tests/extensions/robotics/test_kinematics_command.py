"""``lab kinematics``: the sources' worked examples by a command, and every model against another way to it."""

import json
import re
import tomllib

import numpy as np
import pytest
from helpers.robots import ROOT
from scipy.spatial.transform import Rotation

import lab
from lab.cli.main import main
from lab.core import se3
from lab.robots.load_robot import load_robot

POSE = "--pose=-44.11,383.46,786,77.71,-0.38,170.88"  # Mahdadi & Bouafia 2020, section III.2.2
EIGHT = [  # their table III.3
    (100, 27.12, -64.90, -38.99, 30.72, 120.98), (100, 27.12, -64.90, 141.01, -30.72, -59.02),
    (100, 40, -89, -30, 40, 110), (100, 40, -89, 150, -40, -70),
    (-80, -40, -64.90, 158.99, 63.70, 95.80), (-80, -40, -64.90, -21.01, -63.70, -84.20),
    (-80, -27.12, -89, 156.37, 53.32, 100.78), (-80, -27.12, -89, -23.63, -53.32, -79.22),
]  # fmt: skip


def run(capsys, *arguments: object) -> tuple[int, dict, str]:
    code = main(["kinematics", *map(str, arguments), "--json"])
    said = capsys.readouterr()
    return code, json.loads(said.out) if said.out else {}, said.err


def test_the_two_poses_that_the_thesis_works_out(capsys) -> None:
    _, home, _ = run(capsys, "irb120")
    np.testing.assert_allclose(home["placements"][0]["position_mm"], [374, 0, 630], atol=1e-9)
    np.testing.assert_allclose(home["placements"][0]["rotation"], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-9)
    _, seen, _ = run(capsys, "irb120", "--joints", "0,0,-90,-90,90,-90", "--matrices")
    np.testing.assert_allclose(seen["placements"][0]["position_mm"], [-70, -72, 862], atol=1e-9)
    np.testing.assert_allclose(seen["placements"][0]["rotation"], [[-1, 0, 0], [0, 0, -1], [0, -1, 0]], atol=1e-9)
    np.testing.assert_allclose(seen["link_matrices"][3], [[0, 0, -1, 0], [-1, 0, 0, 0], [0, 1, 0, 302], [0, 0, 0, 1]])
    product = np.linalg.multi_dot([np.array(T) for T in seen["link_matrices"]])
    np.testing.assert_allclose(product, seen["products"][-1], atol=1e-6)


def test_the_eight_solutions_of_the_thesis(capsys) -> None:
    code, seen, _ = run(capsys, "irb120", POSE)
    found = np.array([each["joints"] for each in seen["placements"]])
    assert code == 0 and len(found) == 8
    apart = np.abs(found[:, None] - np.array(EIGHT)).max(axis=2)
    assert sorted(apart.argmin(axis=0)) == list(range(8)) and apart.min(axis=0).max() < 0.01
    sides = [tuple(sorted(each["configuration"].items())) for each in seen["placements"]]
    assert len(set(sides)) == 8  # every configuration once, so that each can be asked for by name
    for each in seen["placements"]:
        np.testing.assert_allclose(each["determinant"], np.linalg.det(each["jacobian"]), rtol=1e-9)

    asked = ",".join(f"{name}{sign}" for name, sign in seen["placements"][5]["configuration"].items())
    _, one, _ = run(capsys, "irb120", POSE, "--of", asked)
    assert [each["joints"] for each in one["placements"]] == [seen["placements"][5]["joints"]]
    assert [of["poses"][0]["in_other_configurations"] for of in (seen, one)] == [0, 7]


def test_the_nearest_solution_comes_first(capsys) -> None:
    for joints in EIGHT[::3]:
        _, seen, _ = run(capsys, "irb120", POSE, "--joints=" + ",".join(map(str, joints)))
        np.testing.assert_allclose(seen["placements"][0]["joints"], joints, atol=0.01)


@pytest.mark.parametrize("name", ["irb120", "versatran", "scara", "delta", "rpr3"])
def test_the_solutions_stand_where_they_were_asked_to_and_hold_the_start(name: str) -> None:
    """The direct model of every solution gives the pose back, for serial arms and for mechanisms."""
    robot = load_robot(name)
    tool, scale = (12.0, -7.0, 55.0), np.where(robot.chain.prismatic, 1e3, 180 / np.pi)
    for joints in robot.chain.random_joints(3, np.random.default_rng(0)) * scale:
        start = lab.solve_kinematics(robot, joints=tuple(joints), tool_mm=tool).to_dict()["placements"][0]
        pose = (*start["position_mm"], *start["quaternion"])
        back = lab.solve_kinematics(robot, pose=pose, tool_mm=tool).to_dict()["placements"]
        for each in back:
            np.testing.assert_allclose(each["position_mm"], start["position_mm"], atol=1e-6)
            np.testing.assert_allclose(each["rotation"], start["rotation"], atol=1e-8)
        turns = np.where(robot.chain.prismatic, np.inf, 360.0)
        off = np.array([each["joints"] for each in back]) - joints
        assert np.abs(off - np.where(np.isinf(turns), 0.0, 360.0) * np.round(off / turns)).max(axis=1).min() < 1e-5


@pytest.mark.parametrize("name", ["irb120", "delta"])
@pytest.mark.parametrize("frame", ["base", "tool"])
def test_rates_and_twist_answer_each_other_and_the_jacobian_is_a_difference_quotient(name: str, frame: str) -> None:
    robot = load_robot(name)
    rng, scale = np.random.default_rng(1), np.where(robot.chain.prismatic, 1e3, 180 / np.pi)
    joints = robot.chain.random_joints(1, rng)[0] * scale
    rates = rng.normal(size=robot.chain.size) * scale
    asked = {"joints": tuple(joints), "tool_mm": (10.0, 20.0, 30.0), "frame": frame}
    direct = lab.solve_kinematics(robot, rates=tuple(rates), **asked).to_dict()["placements"][0]
    back = lab.solve_kinematics(robot, twist=tuple(direct["twist"]), **asked).to_dict()["placements"][0]
    np.testing.assert_allclose(back["rates"], rates, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(back["missing"], 0.0, atol=1e-6)
    Ts = []
    for step in (1e-6, -1e-6):
        moved = lab.solve_kinematics(robot, joints=tuple(joints + step * rates), tool_mm=(10.0, 20.0, 30.0))
        Ts.append(moved.placements[0].T_base_tool)
    speed = np.concatenate([(Ts[0] - Ts[1])[:3, 3], se3.log(Ts[0][:3, :3] @ Ts[1][:3, :3].T)]) / 2e-6
    if frame == "tool":
        speed = np.concatenate([part @ Ts[0][:3, :3] for part in (speed[:3], speed[3:])])
    np.testing.assert_allclose(direct["twist"], speed * np.repeat([1e3, 180 / np.pi], 3), rtol=1e-5, atol=1e-4)


def test_at_a_singularity_the_self_motion_and_what_is_lost_are_named(capsys) -> None:
    _, seen, _ = run(capsys, "irb120")
    (home,) = seen["placements"]
    assert home["rank"] == 5 and home["self_motions"] == [{"q4": 1.0, "q6": -1.0}] and home["factors"]["wrist"] == 0
    jacobian, (lost,) = np.array(home["jacobian"]), home["lost_directions"]
    np.testing.assert_allclose(jacobian[:, 3] - jacobian[:, 5], 0.0, atol=1e-12)
    weights = np.array([1, 1, 1, 0.3, 0.3, 0.3]) ** 2
    np.testing.assert_allclose((weights * lost) @ jacobian, 0.0, atol=1e-8)
    _, along, _ = run(capsys, "irb120", "--twist", ",".join(str(each) for each in np.array(lost) * 1e3))
    assert np.abs(along["placements"][0]["missing"]).max() > 1  # none of it can be had
    _, back, _ = run(capsys, "irb120", "--pose=374,0,630,0,90,0")
    free = [each for each in back["placements"] if each["free"]]
    assert free and all(each["free"] == ["q4"] or each["free"] == ["q4", "q6"] for each in free)
    _, away, _ = run(capsys, "irb120", "--joints", "0,0,0,0,1,0")
    assert away["placements"][0]["rank"] == 6 and away["placements"][0]["self_motions"] == []


def test_a_delta_has_eight_working_modes_and_two_assembly_modes(capsys) -> None:
    _, seen, _ = run(capsys, "delta", "--pose=100,50,-950")
    assert len(seen["placements"]) + seen["poses"][0]["in_other_assembly_modes"] == 8
    assert seen["placements"][0]["configuration"] == {"theta1": "+", "theta2": "+", "theta3": "+"}
    assert seen["placements"][0]["within_limits"] and seen["placements"][0]["position_mm"] == [100, 50, -950]
    _, modes, _ = run(capsys, "delta", "--joints", "0,0,0")
    np.testing.assert_allclose(
        [each["position_mm"][2] for each in modes["assembly_modes"]], [-1064.452, 1064.452], atol=1e-3
    )
    first = modes["assembly_modes"][0]["position_mm"]
    np.testing.assert_allclose(first, modes["placements"][0]["position_mm"], atol=1e-9)


def test_files_of_joint_positions_and_of_targets(tmp_path, capsys) -> None:
    joints = tmp_path / "joints.csv"
    joints.write_text("id,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\nup,0,0,0,0,0,0\nside,0,0,-90,-90,90,-90\n")
    code, seen, _ = run(capsys, "irb120", "--file", joints)
    assert code == 0 and [each["id"] for each in seen["placements"]] == ["up", "side"]
    targets = tmp_path / "targets.csv"
    targets.write_text("id,x_mm,y_mm,z_mm,qw,qx,qy,qz\na,374,0,630,0.70710678,0,0.70710678,0\nfar,900,0,630,1,0,0,0\n")
    code, found, error = run(capsys, "irb120", "--file", targets)
    assert code == 1 and [each["solutions"] > 0 for each in found["poses"]] == [True, False]
    assert found["poses"][1]["out_of_reach_mm"] > 100 and "pose far has no solution" in error


def test_letters_are_printed_as_in_textbooks(capsys) -> None:
    """The matrices of Mallem 2011, section 8.2, for the VERSATRAN, with the two signs that the print has lost."""
    _, seen, _ = run(capsys, "versatran", "--symbolic", "--between", 3, 6)
    T = seen["symbolic"]["T0,6"]
    assert [row[3] for row in T[:3]] == ["−q3 s1", "q3 c1", "q2"]
    assert T[2][:3] == ["−c4 s6 − s4 c5 c6", "s4 c5 s6 − c4 c6", "−s4 s5"]
    assert (
        T[0][1] == "−c1 c4 c5 s6 − c1 s4 c6 − s1 s5 s6"
    )  # the course prints + s1 s5 s6, a misprint and seen["symbolic"]["letters"] == {}
    _, arm, _ = run(capsys, "irb120", "--symbolic")
    assert arm["symbolic"]["T2,3"][0] == ["c3", "0", "−s3", "a3 c3"]
    assert arm["symbolic"]["T0,6"][2][3] == "a2 c2 + a3 c23 + d1 + d6 (−c23 c4 s5 − s23 c5) − d4 s23"
    assert arm["symbolic"]["letters"] == {"d1_mm": 290, "a2_mm": 270, "a3_mm": 70, "d4_mm": 302, "d6_mm": 72}


def test_an_arm_without_a_closed_form_is_searched_and_says_so(capsys) -> None:
    _, seen, _ = run(capsys, "panda", "--pose=400,100,400,180,0,0")
    assert seen["poses"][0]["solutions"] >= 2 and seen["poses"][0]["by"] == "search"


def test_a_ur_has_all_its_solutions_with_their_configurations(capsys) -> None:
    _, seen, _ = run(capsys, "ur10", "--pose=-600,300,400,0,90,0")
    assert seen["poses"][0]["solutions"] == 8 and seen["poses"][0]["by"] == "closed form"
    sides = [tuple(each["configuration"].items()) for each in seen["placements"]]
    assert len(set(sides)) == 8 and {name for each in sides for name, _ in each} == {"elbow", "wrist", "shoulder"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("irb120", "--joints", "1,2"), "--joints has 2 numbers, not 6; give one number for each joint: q1 in °"),
        (("irb120", "--pose", "1,2"), "--pose has 2 numbers"),
        (("irb120", "--pose", "1,2,3,1,1,0,0"), "quaternion's norm is 1.41421"),
        (("irb120", "--joints", "nan,0,0,0,0,0"), "--joints nan: give finite numbers"),
        (("irb120", POSE, "--of", "knee+"), "--of knee+: no configuration is called so; there are elbow+ and elbow-"),
        (("irb120", POSE, "--of", "elbow+,elbow-"), "a solution has one of the two; ask for one"),
        (("irb120", "--of", "elbow+"), "--of chooses among solutions"),
        (("irb120", "--rates", "1,1,1,1,1,1", "--twist", "1,1,1,1,1,1"), "each other's answer"),
        (("irb120", "--between", "4", "9"), "give two frames of 0 to 6"),
        (("delta", "--matrices"), "link matrices are of serial arms"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_line(capsys, arguments: tuple[str, ...], words: str) -> None:
    code, seen, error = run(capsys, *arguments)
    assert code == 2 and words in error and len(error.splitlines()) == 1 and words in seen["error"]["message"]


def test_a_folder_holds_a_table_of_the_solutions(tmp_path, capsys) -> None:
    run(capsys, "irb120", POSE, "--out", tmp_path / "run")
    files = {path.name for path in (tmp_path / "run").iterdir()}
    assert files == {"SHA256SUMS", "config.json", "result.json", "joints.csv", "report.html"}
    code, again, _ = run(capsys, "irb120", "--file", tmp_path / "run" / "joints.csv", "--joints=1,2,3,4,5,6")
    assert code == 0 and len(again["poses"]) == 8  # it has poses too, so that its rows are targets


def test_a_freedom_that_an_arm_does_not_have_is_told_in_one_line() -> None:
    """Of five axes the third turn; of a planar arm a place off its plane, and nothing of poses that they can take."""
    stands = lab.solve_kinematics("scorbot", joints=(20, 40, -50, 10, 30)).placements[0]
    angles = np.rad2deg(se3.roll_pitch_yaw(stands.T_base_tool[:3, :3]))
    taken = lab.solve_kinematics("scorbot", pose=(*(1e3 * stands.T_base_tool[:3, 3]), *angles))
    assert len(taken.placements) == 4 and not taken.warnings and taken.reached[0].how == "closed form"
    asked = lab.solve_kinematics("scorbot", pose=(300, 100, 400, 10, 20, 30))
    (line,) = asked.warnings
    assert "asks for a turn that an arm of 5 joints does not have" in line and "missed by 5.89° about" in line
    assert asked.reached[0].how == "search"
    for each in asked.placements:
        np.testing.assert_allclose(each.T_base_tool[:3, 3], [0.3, 0.1, 0.4], atol=1e-9)
        assert np.rad2deg(each.tilt_rad) == pytest.approx(5.89, abs=0.01)
    off = lab.solve_kinematics("planar3r", pose=(500, 200, 20, 0, 0, 60))
    assert not off.placements
    assert off.warnings == (
        "the pose has no solution: it is 20 mm off the plane across (0, 0, 1) in which the arm moves",
    )
    assert len(lab.solve_kinematics("planar3r", pose=(500, 200, 0, 0, 0, 60)).placements) == 2


def test_a_pose_that_a_search_misses_is_told_with_its_distance(capsys: pytest.CaptureFixture[str]) -> None:
    """An orientation that is free leaves an arm of five axes to the search, which says how near it came."""
    assert main(["kinematics", "scorbot", "--pose", "3000,0,0"]) in (0, 1)
    told = capsys.readouterr()
    said = re.search(r"the nearest place found is ([\d.]+) mm away", told.err + told.out)
    assert said is not None and 2000 < float(said[1]) < 3000
    assert "0 solutions by search: there may be some" in told.out


def test_a_hexapod_s_inverse_is_unique(capsys) -> None:
    """Own lengths |R b + p - a| from the description's text, at the platform and at a tool's point."""
    text = tomllib.loads((ROOT / "models" / "hexapod" / "mechanism.toml").read_text())
    places = {f["name"]: [next(iter(step.values())) for step in f["path"]] for f in text["frame"]}
    R = Rotation.from_euler("xyz", [7, -5, 11], degrees=True)
    place = np.array([40.0, -20, 650])
    lengths = [np.linalg.norm(R.apply(places[f"B{i}"]) + place - places[f"A{i}"]) for i in range(1, 7)]
    code, seen, _ = run(capsys, "hexapod", "--pose=40,-20,650,7,-5,11")
    assert code == 0 and seen["poses"][0]["by"] == "closed form" and seen["poses"][0]["solutions"] == 1
    np.testing.assert_allclose(seen["placements"][0]["joints"], lengths, atol=1e-6)
    moved = place + R.apply([10, 20, 30])
    code, seen, _ = run(capsys, "hexapod", "--pose={},7,-5,11".format(",".join(map(str, moved))), "--tool-mm=10,20,30")
    np.testing.assert_allclose(seen["placements"][0]["joints"], lengths, atol=1e-6)
    main(["kinematics", "hexapod", "--pose=40,-20,650,7,-5,11"])
    assert "1 solution in closed form: there are no others" in capsys.readouterr().out


def test_an_irb_340_s_legs_and_its_fourth_axis_are_in_closed_form(capsys) -> None:
    """Own elbows on the circle of each arm at the rod's length from its wrist, both branches, and the yaw."""
    robot, place, yaw = str(ROOT / "models" / "delta" / "irb340.toml"), np.array([60.0, -40.0, -720.0]), 250.0
    tool = Rotation.from_euler("z", yaw, degrees=True).apply([30, 10, 5])
    text = ",".join(map(str, place + tool))
    code, seen, _ = run(capsys, robot, f"--pose={text},0,0,{yaw}", "--tool-mm=30,10,5")
    pose = seen["poses"][0]
    assert code == 0 and pose["by"] == "closed form" and pose["solutions"] + pose["in_other_assembly_modes"] == 8
    found = np.array([each["joints"] for each in seen["placements"]])
    for i, azimuth in enumerate(np.deg2rad([-90, 30, 150])):
        out = np.array([np.cos(azimuth), np.sin(azimuth), 0])
        d = place + 52 * out - 200 * out  # from the hip to the wrist
        k = (d @ d + 354.5**2 - 800**2) / (2 * 354.5)
        middle, spread = np.arctan2(-d[2], d @ out), np.arccos(k / np.hypot(d @ out, d[2]))
        own = np.rad2deg([middle - spread, middle + spread])
        assert np.abs((found[:, i, None] - own + 180) % 360 - 180).min(axis=1).max() < 1e-6
    assert np.abs((found[:, 3] - yaw + 180) % 360 - 180).max() < 1e-6 and np.abs(found[0, 3]) < 400
    assert set(seen["placements"][0]["configuration"]) == {"theta1", "theta2", "theta3"}
    code, tilted, _ = run(capsys, robot, f"--pose={text},2,0,{yaw}")
    assert code == 1 and tilted["poses"][0]["solutions"] == 0  # its platform does not tilt
    code, free, _ = run(capsys, robot, "--pose=60,-40,-720")
    assert free["poses"][0]["by"] == "closed form" and free["placements"][0]["free"] == ["theta4"]
    main(["kinematics", robot, "--pose=60,-40,-720"])
    told = capsys.readouterr().out
    assert "theta4 may have any position" in told and "singular: theta4" not in told
