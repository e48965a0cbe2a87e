"""``import lab``: what it offers, what it costs, and that its examples are true."""

import doctest
import inspect
import subprocess
import sys
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from types import FunctionType

import pytest

import lab
from lab.cli.commands import all_commands
from lab.core.errors import LabError
from lab.options.compensation import CompensateOptions
from lab.options.option_groups import Fitting
from lab.options.virtual_campaign import VirtualCampaign

ROOT = Path(__file__).resolve().parents[1]


def loaded_by(code: str) -> set[str]:
    """Return the modules that a new Python process has loaded after some code."""
    command = [sys.executable, "-c", f"import sys; {code}; print(*sys.modules)"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    return set(printed.splitlines()[-1].split())


def test_the_import_loads_nothing_heavy() -> None:
    heavy = {"mujoco", "rerun", "matplotlib", "pyarrow", "numpy", "scipy", "tyro"}
    assert not heavy & loaded_by("import lab; dir(lab)")


@pytest.mark.thorough
def test_using_it_loads_neither_drawing_nor_recording() -> None:
    used = loaded_by("import lab; lab.identify(lab.simulate(poses=20).measurements)")
    assert not {"rerun", "matplotlib", "pyarrow", "pandas"} & used


def test_help_loads_nothing_heavy() -> None:
    used = loaded_by("from lab.cli.main import main; main(['--help'])")
    assert not {"mujoco", "rerun", "matplotlib", "pyarrow", "numpy", "scipy"} & used


def test_every_name_is_there_and_no_other() -> None:
    assert len(set(lab.__all__)) == len(lab.__all__) and dir(lab) == sorted(lab.__all__)
    for name in set(lab.__all__) - {"__version__"}:
        assert getattr(lab, name).__name__ == name and getattr(lab, name).__doc__
    with pytest.raises(AttributeError, match=r"'calibrat': is calibrate meant\? There are .*verify"):
        _ = lab.calibrat
    with pytest.raises(AttributeError, match=r"'zzz'; there are .*calibrate"):
        _ = lab.zzz


def test_every_command_has_calls_with_the_command_s_options() -> None:
    for command in all_commands():
        module = command.run.partition(":")[0]
        calls = [getattr(lab, name) for name in set(lab.__all__) - {"__version__"}]
        own = [call for call in calls if isinstance(call, FunctionType) and call.__module__ == module]
        taken = {name for call in own for name in inspect.signature(call).parameters}
        options = {field.name for field in fields(command.load_options())} - {"fitting", "effects", "rehearsal"}
        assert own and options - taken <= {"file", "config", "check", "plan", "observe"}, command.name


@pytest.mark.sampled(18)
@pytest.mark.parametrize("name", sorted({"", *lab.__all__} - {"__version__"}))
def test_examples_are_true(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # some save what they show
    thing = getattr(lab, name) if name else lab
    if isinstance(thing, FunctionType):  # a module's names, so that helpers are found
        module = import_module(thing.__module__)
        found = doctest.DocTestFinder(recurse=False).find(thing, name, module=module)
    else:
        found = doctest.DocTestFinder(recurse=False).find(thing, name or "lab", module=False)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    for each in found:
        runner.run(each)
    assert runner.summarize(verbose=False).failed == 0
    assert not isinstance(thing, FunctionType) or name in NO_EXAMPLE or runner.tries, f"{name} has no example"


NO_EXAMPLE = {"study"}  # it needs a file and processes: its page shows it


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (
            lambda: lab.calibrate(pose=3),
            "lab.calibrate: 'pose' is no option: is poses meant. There are robot, cell, poses",
        ),
        (lambda: lab.calibrate(zzz=3), "lab.calibrate: 'zzz' is no option; there are robot, cell, poses"),
        (lambda: lab.calibrate(VirtualCampaign(), seed=3), "lab.calibrate: seed is given beside a VirtualCampaign"),
        (lambda: lab.compensate(CompensateOptions(Path("t")), Path("run")), "run is given beside a CompensateOptions"),
        (lambda: lab.identify("x.csv", file="y.csv"), "lab.identify: file and measurements are the same, given twice"),
        (
            lambda: lab.verify("run", "x.csv", file="y.csv"),
            "lab.verify: file and measurements are the same, given twice",
        ),
        (lambda: lab.verify("run", file="y.csv"), "lab.verify: file is no option here; give measurements alone"),
        (lambda: lab.calibrate("irb120", poses="many"), "lab.calibrate: 'many' is not a value of option 'poses'"),
        (lambda: lab.calibrate("irb121"), "robot 'irb121': no such model"),
        (lambda: lab.simulate(targets=3), "give a list, each a text"),
        (lambda: lab.compensate("targets.csv"), "lab.compensate: 'run' is missing"),
        (lambda: lab.verify("run"), "give the new measurements"),
        (lambda: lab.simulate(effects=3), r"lab.simulate: effects is 3; give effects=lab.Effects\("),
        (lambda: lab.simulate(effects=lab.Effects(gear_ppm="x")), "'x' is not a value of option 'effects.gear_ppm'"),
        (lambda: lab.Effects(gear_pmm=3), "lab.Effects: 'gear_pmm' is no option: is gear_ppm meant"),
        (lambda: lab.Effects(zzz=3), "lab.Effects: 'zzz' is no option; there are stiffness_nm_per_rad"),
        (
            lambda: lab.verify(lab.measurements([[0.0] * 6], robot="irb120"), "run"),
            "lab.verify: the measurements are given first; give the run first",
        ),
        (lambda: lab.study({"name": "x", "factors": {"plan": ["x"]}}), "^lab.study: factor plan: x: cannot be read"),
        (lambda: lab.study({"name": "x"}, parts=[lambda information, task: 0.0]), "^parts: .* is a function.* factor"),
        (lambda: lab.simulate(model="auto"), "lab.simulate: model changes nothing here"),
        (lambda: lab.study("study.toml", workers=1.5), "study.toml"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(call, says: str) -> None:
    with pytest.raises(LabError, match=says) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.thorough
def test_the_calls_are_the_commands(tmp_path, capsys) -> None:
    """The same options by keywords, as an object and on the command line give the same parameters."""
    from lab.cli.main import main

    assert (
        main(["calibrate", "--seed", "3", "--poses", "20", "--model", "gear", "--json", "--out", f"{tmp_path}/c"]) == 0
    )
    capsys.readouterr()
    options = VirtualCampaign(seed=3, poses=20, fitting=Fitting("gear"))
    for number, result in enumerate((lab.calibrate(seed=3, poses=20, model="gear"), lab.calibrate(options))):
        folder = result.save(tmp_path / str(number))
        for file in ("parameters.json", "measurements.csv", "config.json"):
            assert (folder / file).read_bytes() == (tmp_path / "c" / file).read_bytes(), file


@pytest.mark.thorough
def test_measurements_in_memory_are_a_virtual_campaign() -> None:
    day = lab.simulate("irb120", poses=30, seed=5)
    found = lab.identify(day.measurements, robot=day.robot, instrument="uniform-8um", validate=day.validation)
    whole = lab.calibrate("irb120", poses=30, seed=5)
    assert found.to_dict()["after_mm"] == whole.to_dict()["after_mm"]


def test_effects_are_one_argument_and_what_the_fit_alone_needs_is_none_of_a_simulation() -> None:
    shown = inspect.signature(lab.simulate).parameters
    assert "effects" in shown and not {"gear_ppm", "model", "require", "gate_mm"} & set(shown)
    own = lab.simulate("irb120", poses=6, seed=3, effects=lab.Effects(gear_ppm=50, payload_kg=[0, 3]))  # type: ignore[arg-type]
    assert own.options.effects == lab.Effects(gear_ppm=50.0, payload_kg=(0.0, 3.0))
    assert own == lab.simulate("irb120", poses=6, seed=3, gear_ppm=50.0, payload_kg=(0.0, 3.0))
    assert own != lab.simulate("irb120", poses=6, seed=3)
    with pytest.raises(LabError, match="gear_ppm is given beside effects, which has it too; give it in one of them"):
        lab.simulate("irb120", poses=6, effects=lab.Effects(gear_ppm=50.0), gear_ppm=20.0)
