"""One entry registers a command: its options become its command line, and its refusals one line."""

import json
import re
import shutil
import subprocess
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
import tyro

from lab.cli.command_line import parsed
from lab.cli.commands import all_commands, command_named
from lab.cli.main import main
from lab.core import se3
from lab.core.errors import LabError
from lab.formats.structured import structured
from lab.library.given_measurements import read_measurements, world_frames, write_measurements
from lab.options import command as registry
from lab.options.call_options import options_of
from lab.options.command import Command
from lab.options.option_groups import Effects, Fitting
from lab.options.virtual_campaign import VirtualCampaign


@dataclass(frozen=True)
class ThrowAwayOptions:
    file: tyro.conf.Positional[Path]
    count: int = 3
    size: float | None = None
    fitting: tyro.conf.OmitArgPrefixes[Fitting] = field(default_factory=Fitting)


THROW_AWAY = Command("throw", "Nothing.", f"{__name__}:ThrowAwayOptions", f"{__name__}:nothing", "throw-{file}-{count}")


@pytest.fixture
def throw_away(monkeypatch: pytest.MonkeyPatch) -> Command:
    monkeypatch.setattr(registry, "load_reference", lambda reference: globals()[reference.partition(":")[2]])
    return THROW_AWAY


def test_a_command_is_its_options_and_an_entry(throw_away: Command) -> None:
    found = parsed(throw_away, ["a/b.csv", "--size", "1.5", "--fix", "link1.d,tool.*", "--out", "here", "--json"])
    assert found.options == ThrowAwayOptions(Path("a/b.csv"), 3, 1.5, Fitting(fix=("link1.d", "tool.*")))
    assert found.out == Path("here") and found.json
    assert throw_away.folder_name(found.options) == "throw-b-3"
    assert parsed(throw_away, ["a", "--size", "None"]).options.size is None


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("", "give file (PATH); see lab throw --help"),
        ("a b", "b is not understood; see"),
        ("a --cont 3", "--cont 3 is not understood; is --count meant?; see"),
        ("a --file b", "--file b is not understood; give it without --file; see"),
        ("a 20", "20 is not understood; separate the numbers of one option by commas, without spaces; see"),
        ("a --count 1.5", "--count: '1.5' is not a whole number; see"),
        ("a --size big", "--size: 'big' is not a number; see"),
        ("a --count", "--count: its value is missing; see"),
        ("a --config", "--config: give the config.json"),
    ],
)
def test_what_cannot_be_parsed_is_one_line(throw_away: Command, arguments: str, says: str) -> None:
    with pytest.raises(LabError) as caught:
        parsed(throw_away, arguments.split())
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_names_are_looked_up() -> None:
    assert [command_named(each.name) for each in all_commands()] == list(all_commands())
    with pytest.raises(LabError, match="'throw' is no command"):
        command_named("throw")


def test_keywords_are_options_those_of_groups_among_them() -> None:
    found = options_of("call", VirtualCampaign, {"poses": 7, "model": "gear", "gear_ppm": 3})
    assert found == VirtualCampaign(poses=7, fitting=Fitting("gear"), effects=Effects(gear_ppm=3.0))
    with pytest.raises(LabError, match=r"call: 'fitting' is no option"):
        options_of("call", VirtualCampaign, {"fitting": Fitting()})


def test_measurements_come_back_and_their_frame_is_the_world_s(tmp_path: Path) -> None:
    from lab.library.simulate import simulate

    day = simulate("irb120", poses=8, seed=2, instrument="exact", position_sigma_mm=0, rotation_sigma_mrad=0)
    write_measurements(tmp_path / "day.csv", day.measurements, day.robot)
    back = read_measurements(tmp_path / "day.csv", "irb120")
    assert (back.points == day.measurements.points).all() and (back.joints == day.measurements.joints).all()
    frames, arm = world_frames(day), day.robot.arm(("p1",))
    in_world = se3.transform(frames.T_world_instrument, back.points[:, 0])
    values = arm.nominal(day.robot.tool)
    in_base = se3.transform(se3.inverse(arm.T_tracker_frame0(values)), arm.points(back.joints, values)[:, 0])
    assert abs(in_world - se3.transform(frames.T_world_base, in_base)).max() < 1e-12
    assert abs(world_frames("irb120").T_world_base - frames.T_world_base).max() == 0


@pytest.mark.parametrize(
    ("name", "says"), [("design", "is --robot tx40 meant?"), ("inspect", "is not understood; see")]
)
def test_a_robot_without_its_option_is_told_how_it_is_given(name: str, says: str) -> None:
    """Where a robot stands without an option, one word more is none."""
    with pytest.raises(LabError, match=re.escape(says)):
        parsed(command_named(name), ["irb120", "tx40"][name == "design" :])


@pytest.mark.parametrize(
    ("arguments", "mode"),
    [
        ("a", "auto"), ("a --prior", "on"), ("--prior a", "on"), ("a --prior --size 2", "on"), ("a --prior on", "on"),
        ("a --prior off", "off"), ("a --prior=off", "off"), ("--prior auto a", "auto"),
    ],
)  # fmt: skip
def test_a_bare_prior_is_on(throw_away: Command, arguments: str, mode: str) -> None:
    found = parsed(throw_away, arguments.split()).options
    assert found.fitting.prior == mode and found.file == Path("a")


def test_truth_values_of_older_calls_and_runs_are_read() -> None:
    for given, mode in ((True, "on"), (False, "off"), ("auto", "auto"), ("on", "on"), ("off", "off")):
        assert Fitting(prior=given).prior == mode
        assert structured("", Fitting, {"prior": given}).prior == mode
        assert options_of("lab.identify", ThrowAwayOptions, {"file": "a", "prior": given}).fitting.prior == mode
    with pytest.raises(LabError, match=r"'sometimes' .* option 'prior'"):
        structured("", Fitting, {"prior": "sometimes"})
    with pytest.raises(LabError, match="--prior sometimes: give auto, on, off"):
        Fitting(prior="sometimes").check()


@pytest.mark.thorough
def test_bash_completes_commands_options_and_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if shutil.which("bash") is None:
        pytest.skip("no bash")
    assert main(["--completion", "bash"]) == 0
    script = tmp_path / "lab.bash"
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    wanted = {
        "cal": {"calibrate"},
        "calibrate --pos": {"--poses", "--position-sigma-mm"},
        "identify a --prior o": {"on", "off"},
    }
    lines = [
        f'COMP_WORDS=(lab {each}); COMP_CWORD={len(each.split())}; _tyro_lab; echo "${{COMPREPLY[*]}}"'
        for each in wanted
    ]
    done = subprocess.run(
        ["bash", "-c", "\n".join([f"source {script}", *lines])], capture_output=True, text=True, check=True
    )
    assert [set(line.split()) for line in done.stdout.splitlines()] == list(wanted.values())


@pytest.mark.parametrize("given", [["ksh"], [], ["bash", "zsh"]])
def test_completion_of_another_shell_is_refused(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion", *given]) == 2
    assert "give bash, zsh or fish" in capsys.readouterr().err


def test_options_are_added_to_those_of_an_earlier_run(tmp_path: Path, throw_away: Command) -> None:
    config = tmp_path / "config.json"
    content = {
        "schema": 1,
        "command": "throw",
        "options": {"file": "a", "count": 5, "fitting": {"robust": True, "fix": ["link1.d"]}},
    }
    config.write_text(json.dumps(content))
    found = [
        parsed(throw_away, ["--config", str(config), *more]).options
        for more in ([], ["--robust"], ["--size", "2", "--robust"], ["--no-robust"])
    ]
    given = ThrowAwayOptions(Path("a"), 5, None, Fitting(robust=True, fix=("link1.d",)))
    off = replace(given, fitting=Fitting(fix=("link1.d",)))
    assert found == [given, given, replace(given, size=2.0), off]
