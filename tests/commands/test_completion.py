"""Shell completion: the scripts are valid, and bash completes commands, flags and words with them."""

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from lab.campaign.model_files import own_models
from lab.cli import main
from lab.commands.completion import SHELLS, completion_script
from lab.commands.help_text import options_of_command
from lab.commands.registry import all_commands


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("bash") is None:
        pytest.skip("no bash")
    path = tmp_path_factory.mktemp("completion") / "lab.bash"
    path.write_text(completion_script("bash"), encoding="utf-8")
    return path


def completed(script: Path, *words: str) -> list[str]:
    """Complete the last word of ``lab WORDS`` in bash."""
    line = " ".join(map(shlex.quote, ("lab", *words)))
    code = f"source {shlex.quote(str(script))}; COMP_WORDS=({line}); COMP_CWORD={len(words)}; _lab; "
    code += 'printf "%s\\n" "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True, cwd=script.parent)
    return done.stdout.split()


def test_bash_completes_commands_flags_and_words(script: Path) -> None:
    assert subprocess.run(["bash", "-n", str(script)], check=False).returncode == 0
    assert completed(script, "cal") == ["calibrate"] and completed(script, "comp") == ["compensate", "compare"]
    assert {each.name for each in all_commands()} < set(completed(script, ""))
    assert completed(script, "calibrate", "--pos") == ["--poses", "--position-sigma-mm"]
    assert completed(script, "identify", "day.csv", "--help") == ["--help", "--help-all"]
    assert completed(script, "calibrate", "--observe", "po") == ["points", "pose"]
    assert completed(script, "reproduce", "th") == ["thesis"]
    assert completed(script, "--completion", "f") == ["fish"]
    for command in all_commands():
        flags = {each.flag for each in options_of_command(command) if not each.positional}
        assert set(completed(script, command.name, "--")) == flags | {"--help", "--help-all"}


def test_bash_completes_names_of_robots(script: Path) -> None:
    """By every command that takes one; where none begins so, the shell proposes files."""
    assert completed(script, "calibrate", "--robot", "irb14") == ["irb140"]
    assert completed(script, "design", "--robot", "delta/s") == ["delta/six_rods", "delta/small"]
    assert completed(script, "inspect", "tx") == completed(script, "kinematics", "tx") == ["tx40"]
    assert completed(script, "workspace", "ur1") == ["ur10", "ur10e", "ur16e"]
    assert completed(script, "calibrate", "--robot", "arm.x") == []
    robots = set(completed(script, "identify", "day.csv", "--robot", ""))
    assert robots == set(own_models()) and not robots & set(completed(script, "identify", "--instrument", ""))


def test_bash_leaves_files_to_itself(script: Path) -> None:
    """No word of the lab is proposed for a file, so that ``complete -o default`` proposes files."""
    assert completed(script, "identify", "d") == completed(script, "calibrate", "--plan", "r") == []
    assert "complete -o default -F _lab lab" in script.read_text(encoding="utf-8")


def test_fish_is_given_every_flag_with_its_words() -> None:
    lines = [shlex.split(line.replace("\\'", "")) for line in completion_script("fish").splitlines()]
    assert all(line[:3] == ["complete", "-c", "lab"] for line in lines)
    there = {(line[4].split()[-1], line[line.index("-l") + 1]) for line in lines if "-l" in line}
    for command in all_commands():
        for each in options_of_command(command):
            assert each.positional or (command.name, each.flag[2:]) in there
    (prior,) = (line for line in lines if line[4].endswith("identify") and "prior" in line)
    assert prior[prior.index("-xa") + 1] == "auto on off"


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_itself_accepts_the_script(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell}")
    (tmp_path / "lab").write_text(completion_script(shell), encoding="utf-8")
    done = subprocess.run([shell, "-n", str(tmp_path / "lab")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("given", [["ksh"], [], ["bash", "zsh"]])
def test_another_shell_is_refused(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion", *given]) == 2
    assert "give bash, zsh or fish" in capsys.readouterr().err


def test_the_command_line_prints_the_script(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion", "zsh"]) == 0
    printed = capsys.readouterr().out
    assert printed == completion_script("zsh") and printed.endswith(completion_script("bash"))
