"""From rendered pictures to an identified arm: corners found by OpenCV, and intervals against the truth.

Each set has a virtual arm, a camera in its hand with a distorting lens, and a board on a table. Its pictures are
rendered with blur and noise and written as PNG beside a file of joint positions, which is all that identification is
given. It needs OpenCV (extra ``camera``).
"""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rendered_boards import rendered
from shared import Answer, Document, Flag, Section, Table, run_script, short

import lab
from lab.calibration.validation import compare_with_truth, validate_file
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_virtual
from lab.campaign.virtual_robot import truth_of
from lab.commands.calibrate.run import measurement_session
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.sensors.cameras.closed_forms import board_poses
from lab.sensors.cameras.geometry import sight_lines
from lab.sensors.cameras.rig import PX, Board, Rig, read_rig

_CAMERA = """[[camera]]
size_px = [640, 480]
focal_px = [620.0, 621.0]
centre_px = [321.0, 238.5]
distortion = [-0.15, 0.05, 0.001, -0.0005, 0.0]
"""
BOARDS = {
    "checkerboard": 'kind = "checkerboard"\ncolumns = 9\nrows = 6\nsquare_mm = 20.0\n',
    "charuco": 'kind = "charuco"\ncolumns = 7\nrows = 5\nsquare_mm = 24.0\nmarker_mm = 18.0\n',
    "apriltag": 'kind = "apriltag"\ncolumns = 4\nrows = 3\ntag_mm = 32.0\ngap_mm = 12.0\n',
}
_SIMULATED = "[simulated]\ncorners = {corners}\nincidence_deg = 50.0\nnearest_mm = 250.0\nfarthest_mm = 500.0\n"


@dataclass(frozen=True)
class Options:
    """How much to render."""

    sets: int = 20
    """Sets, of each kind of board in turn."""
    poses: int = 16
    """Pictures of a set."""
    noise_grey: float = 5.0
    """Noise of the grey levels, of 256 (1 sigma)."""
    first: int = 0
    """Seed of the first."""
    robot: str = "irb120"
    """Which arm."""
    json: Flag = False
    """Print one JSON object."""


def _poses_of_board(rig: Rig, board: Board, data: lab.Measurements) -> tuple[Array, Array]:
    """Return joint positions and poses of the board in the camera, from exact corners."""
    joints, row = np.unique(data.joints, axis=0, return_inverse=True)
    flat = np.full((len(joints), len(board), 2), np.nan)
    places = PX.to_si(np.column_stack([data.conditions["u_px"], data.conditions["v_px"]]))
    flat[row, np.array(data.other["corner"], dtype=np.int_)] = sight_lines(places, rig.cameras[0].intrinsic_values)
    return joints, board_poses(board.corners, flat)[0]


def one_set(options: Options, seed: int, kind: str, folder: Path) -> dict[str, float]:
    """Render a set, identify the arm from its pictures, and compare with the truth.

    Raises:
        LabError: OpenCV is not installed, or no board was found.
    """
    cv2 = import_module("cv2")  # the extra, which not every environment has

    file, text = folder / "cameras.toml", _CAMERA + "[[board]]\n" + BOARDS[kind]
    file.write_text(text, encoding="utf-8")
    corners = len(read_rig(file).boards[0])
    file.write_text(text + _SIMULATED.format(corners=corners), encoding="utf-8")
    rig, robot = read_rig(file), load_virtual(options.robot)
    virtual = VirtualCampaign(
        options.robot, observe="pixels", cameras=file, poses=options.poses, seed=seed, instrument="exact"
    )
    day, placed = measurement_session(virtual, robot)
    joints, Ts = _poses_of_board(rig, rig.boards[0], day.measurements)
    lines = [",".join(("id", "image", *(f"{name}_rad" for name in robot.chain.joint_names)))]
    for i, (position, T) in enumerate(zip(joints, Ts, strict=True)):
        picture = rendered(rig.cameras[0], rig.boards[0], T, rng_for(seed, "noise", i), noise_grey=options.noise_grey)
        cv2.imwrite(str(folder / f"{i:03}.png"), picture)
        lines.append(",".join((str(i), f"{i:03}.png", *map(repr, position.tolist()))))
    (folder / "joints.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    result = lab.identify(folder / "joints.csv", robot=options.robot, observe="pixels", cameras=file)
    found, truth = result.identification, truth_of(day.true_robot, robot.arm(("p1",)))
    seen = None if truth is None else virtual.kind().observed_truth(truth, found, day.true_robot, placed)
    if seen is None:
        raise LabError(f"--robot {options.robot}: its parameters have no single truth; take a serial arm")
    compared = compare_with_truth(found, seen)
    fresh = validate_file(found, robot.arm(("p1",)), day.validation, found.unplaced).errors
    assert fresh is not None
    return {
        "pictures": float(len(np.unique(result.fitted.joints, axis=0))),
        "corners_found": len(result.measurements) / (corners * options.poses),
        "outliers": float(len(result.fit.outliers)),
        "noise_px": float(PX.of(found.sigma_m)),
        "before_mm": float(1e3 * fresh.before.mean()),
        "after_mm": float(1e3 * fresh.after.mean()),
        "coverage": compared.coverage_95,
        "nees_per_parameter": compared.nees_per_parameter,
    }


def answer(options: Options) -> Answer:
    """Render and identify all sets.

    Raises:
        LabError: OpenCV is not installed.
    """
    results, rows = list[dict[str, float]](), []
    for i in range(options.sets):
        kind = tuple(BOARDS)[i % len(BOARDS)]
        with TemporaryDirectory() as folder:
            found = one_set(options, options.first + i, kind, Path(folder))
        results.append({"kind": kind, **found})  # type: ignore[dict-item]
        rows.append((kind, *(short(value) for value in found.values())))
    means = {name: float(np.mean([each[name] for each in results])) for name in list(results[0])[1:]}
    head = ("board", *(name.replace("_", " ") for name in means))
    rows.append(("mean", *(short(value) for value in means.values())))
    return Answer(
        {"sets": results, "mean": means},
        Document("Rendered pictures", (Section("Sets", (Table(head, tuple(rows), ""),)),)),
    )


if __name__ == "__main__":
    run_script("camera_detection")
