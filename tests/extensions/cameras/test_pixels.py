"""Corners of boards in pictures: the model, recovery without noise, intervals, wrong corners, and refusals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120, assert_derivatives

import lab
from lab.calibration.fit_options import PLAIN
from lab.calibration.identification import fit_base_and_tool, identify
from lab.calibration.weights import Noise, weigh
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.extensions.cameras.pixels import PixelSensor
from lab.extensions.cameras.rig import PX, Board, Camera, Rig, Simulated
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.tree import TreeArm
from lab.sensors.sensor_options import CameraOptions, FitInputs

ARM = SerialArm(IRB120.chain)
SMALL = Board(columns=5, rows=4, square_mm=30.0, size_u_percent=0.0)
LENS = Camera(intrinsics="free", distortion=(-0.2, 0.05, 0.001, -0.001, 0.0))
HAND = Rig((Camera(),), (SMALL,))
RIGS = {
    "hand": HAND,
    "world": Rig((Camera(fixed_to="world"),), (replace(SMALL, fixed_to="hand"),)),
    "lens": Rig((LENS,), (replace(SMALL, size_u_percent=np.inf),)),
    "several": Rig(
        (Camera(name="wrist"), Camera(name="wall", fixed_to="world")),
        (replace(SMALL, name="table"), replace(SMALL, name="plate", fixed_to="hand")),
    ),
}


def session(rig: Rig, tmp_path: Path, **options: object) -> lab.MeasurementSession:
    """Simulate pictures with a rig, by its file."""
    return lab.simulate("irb120", observe="pixels", cameras=written(rig, tmp_path), **options)


def written(rig: Rig, folder: Path) -> Path:
    lines = []
    for kind, parts in (("camera", rig.cameras), ("board", rig.boards)):
        for part in parts:
            lines.append(f"[[{kind}]]")
            for key, value in vars(part).items():
                if key != "corners" and value is not None and value != ():
                    lines.append(f"{key} = {list(value) if isinstance(value, tuple) else repr(value)}")
    lines.append("[simulated]")
    lines += [f"{key} = {value}" for key, value in vars(rig.simulated).items() if value is not None]
    file = folder / "cameras.toml"
    file.write_text("\n".join(lines).replace("'", '"') + "\n")
    return file


@pytest.mark.parametrize("name", RIGS)
def test_derivatives_are_those_of_the_prediction(name: str, tmp_path: Path) -> None:
    rig = RIGS[name]
    data = session(rig, tmp_path, poses=4, instrument="exact", seed=1).measurements
    nominal = ARM.nominal(IRB120.tool)
    model, observed = PixelSensor(rig).observation(ARM, data, nominal)
    inputs = observed.inputs(model.conditions)[:: max(len(observed) // 12, 1)]
    rng = np.random.default_rng(0)
    values = fit_base_and_tool(model, weigh(model, observed, Noise())[0], model.nominal(nominal))
    values = values + 1e-3 * rng.standard_normal(len(model.names))
    values[model.names.index("base.rz")] = 0.3
    assert_derivatives(lambda v: model.points(inputs, v), model.observe(inputs, values)[1], values)


@pytest.mark.parametrize("name", ["hand", "world", pytest.param("several", marks=pytest.mark.thorough)])
def test_without_noise_everything_is_found(name: str, tmp_path: Path) -> None:
    result = lab.calibrate(
        "irb120", observe="pixels", cameras=written(RIGS[name], tmp_path), poses=16, instrument="exact", seed=3
    )
    assert result.identification.status == "converged" and result.truth.comparison is not None
    assert np.abs(result.truth.comparison.error).max() < 1e-9
    assert result.validated and result.after.max < 1e-6


@pytest.mark.thorough
def test_a_lens_is_identified_with_the_arm(tmp_path: Path) -> None:
    rig = Rig((LENS,), (SMALL,))
    result = lab.calibrate("irb120", observe="pixels", cameras=written(rig, tmp_path), poses=20, seed=2)
    found = dict(zip(result.identification.model.names, result.identification.values, strict=True))
    assert result.truth.comparison is not None and 0.8 < result.truth.comparison.coverage_95 <= 1
    assert PX.of(found["camera.camera.fx"]) == pytest.approx(1200, abs=1.5)
    assert found["camera.camera.k1"] == pytest.approx(-0.2, abs=0.01)
    assert result.to_dict()["noise_px"] == pytest.approx(0.1, rel=0.15) and result.to_dict()["noise_mm"] is None


def test_a_board_of_unknown_size_leaves_the_arm_without_one(tmp_path: Path) -> None:
    """The same numbers are identifiable, but one length of the arm stays nominal for the board's size."""
    data = session(HAND, tmp_path, poses=12, instrument="exact", seed=5).measurements
    nominal, ranks = ARM.nominal(IRB120.tool), {}
    for size, percent in (("known", 0.0), ("free", np.inf)):
        sensor = PixelSensor(Rig((Camera(),), (replace(SMALL, size_u_percent=percent),)))
        model, observed = sensor.observation(ARM, data, nominal)
        found = identify(model, observed, nominal, options=PLAIN)
        ranks[size] = [model.names[i] for i in found.base_set.identifiable]
    lost = set(ranks["known"]) - set(ranks["free"])
    assert set(ranks["free"]) - set(ranks["known"]) == {"board.board.scale"} and len(lost) == 1
    parameter = next(each for each in ARM.parameters if each.name in lost)
    assert parameter.is_link and parameter.kind == "length"


def test_wrong_corners_are_found_one_by_one(tmp_path: Path) -> None:
    rig = replace(HAND, simulated=Simulated(wrong=0.02, wrong_px=8.0))
    result = lab.calibrate("irb120", observe="pixels", cameras=written(rig, tmp_path), poses=20, seed=4, robust=True)
    named = {each.id for each in result.state.outliers}
    assert len(result.truth.outliers) >= 3 and len(named & result.truth.outliers) >= 0.8 * len(result.truth.outliers)
    assert len(named - result.truth.outliers) <= 1
    assert result.to_dict()["noise_px"] == pytest.approx(0.1, rel=0.15)


@pytest.mark.thorough
def test_priors_of_a_lens_hold_it_where_few_pictures_do_not(tmp_path: Path) -> None:
    spread = {}
    data = session(Rig((LENS,), (SMALL,)), tmp_path, poses=8, seed=6).measurements
    for intrinsics in ("free", "prior"):
        camera = replace(LENS, intrinsics=intrinsics, prior_px=0.5, prior_distortion=1e-3)
        sensor = PixelSensor(Rig((camera,), (SMALL,)))
        nominal = ARM.nominal(IRB120.tool)
        model, observed = sensor.observation(ARM, data, nominal)
        found = identify(model, observed, nominal)
        spread[intrinsics] = dict(zip([model.names[i] for i in found.fit.free], found.std, strict=True))
    assert spread["prior"]["camera.camera.fx"] < 1.02 * PX.to_si(0.5) < spread["free"]["camera.camera.fx"] * 2
    assert spread["prior"]["camera.camera.k3"] < 1.02e-3 < spread["free"]["camera.camera.k3"]


def test_what_the_arm_hides_is_not_seen(tmp_path: Path) -> None:
    """A camera behind the base looks through the arm at a board beyond it: the arm hides corners in some poses."""
    placed = Rig(
        (Camera(fixed_to="world", position_mm=(-900.0, 0.0, 400.0), rotation_deg=(-69.3, 69.3, -69.3)),),
        (Board(columns=13, rows=10, square_mm=60.0, fixed_to="world", position_mm=(900.0, 360.0, 700.0),
               rotation_deg=(-69.3, 69.3, -69.3)),),
    )  # fmt: skip
    free = lab.simulate("irb120", poses=6, seed=1).measurements.joints
    plan = tmp_path / "plan.csv"
    lines = [",".join(f"q{j + 1}_rad" for j in range(6)), *(",".join(map(repr, row)) for row in free.tolist())]
    plan.write_text("\n".join(lines) + "\n")
    data = session(placed, tmp_path, plan=plan, instrument="exact").measurements
    seen = {tuple(row): int((data.joints == row).all(axis=1).sum()) for row in np.unique(data.joints, axis=0)}
    assert len(set(seen.values())) > 1 and max(seen.values()) < 130


def corners(rows: int = 8) -> Measurements:
    return lab.simulate("irb120", observe="pixels", poses=2, seed=0).measurements[:rows]


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("corner", "54", "'54' is no corner of board board"),
        ("corner", "-1", "is no corner"),
        ("corner", "", "is no corner"),
        ("board", "plate", "'plate' is unknown; there are board"),
    ],
)
def test_a_cell_that_names_nothing_is_refused(column: str, value: str, said: str) -> None:
    data = corners()
    wrong = replace(data, other={**data.other, column: (value, *data.other[column][1:])})
    with pytest.raises(LabError, match=said):
        PixelSensor().observation(ARM, wrong, ARM.nominal())


def test_missing_columns_are_named() -> None:
    data = corners()
    without = replace(data, conditions={k: v for k, v in data.conditions.items() if k != "u_px"})
    with pytest.raises(LabError, match="column u_px is missing"):
        PixelSensor().observation(ARM, without, ARM.nominal())
    rig = Rig((Camera(name="a"), Camera(name="b")), (Board(),))
    unnamed = replace(data, other={"corner": data.other["corner"]})
    with pytest.raises(LabError, match="column camera is missing: there are 2"):
        PixelSensor(rig).observation(ARM, unnamed, ARM.nominal())
    with pytest.raises(LabError, match="fixed to 'gripper'"):
        PixelSensor(Rig((Camera(fixed_to="gripper"),), (Board(),))).observation(ARM, data, ARM.nominal())
    with pytest.raises(LabError, match=r"noise.px"):
        PixelSensor.configured(CameraOptions(), FitInputs(noise_mm=0.1))


def test_a_hand_of_several_tips_and_an_unknown_target_are_refused(tmp_path: Path) -> None:
    both = TreeArm(lab.load_robot("torso").chain, ("left.p1", "right.p1"))
    with pytest.raises(LabError, match=r"fixed to hand, and the arm has several tips; .*: left.p1, right.p1"):
        HAND.mount(HAND.cameras[0], both.targets)
    assert HAND.mount(Camera(fixed_to="right.p1"), both.targets) == 1
    with pytest.raises(LabError, match="target 'ball' is unknown: robot irb120 has p1, p2, p3"):
        session(Rig((Camera(fixed_to="ball"),), (SMALL,)), tmp_path, poses=8, seed=1)
    with pytest.raises(LabError, match="has several tips: a virtual one is measured by"):
        lab.simulate("torso", observe="pixels", cameras=written(HAND, tmp_path), poses=8, seed=1)
