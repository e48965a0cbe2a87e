"""A folder is there whole or not at all, and nothing that stood there is lost."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lab.core.errors import LabError
from lab.core.whole_folder import checksum_lines, draft_of, edited_files, held, is_being_written

WRITER = """\
import sys, time
from pathlib import Path
from lab.core.whole_folder import draft_of
with draft_of(Path(sys.argv[1]), replacing=False) as draft:
    (draft / "a").write_text("new")
    print(flush=True)
    time.sleep(60)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_ends_well_stands_and_replaces(tmp_path: Path) -> None:
    place = tmp_path / "deep" / "run"
    for text in ("first", "second"):
        with draft_of(place, replacing=text == "second") as draft:
            (draft / text).write_text(text)
            assert is_being_written(place) and (text == "first" or names(place) == ["first"])
        assert names(place) == [text] and names(place.parent) == ["run"] and not is_being_written(place)
    assert place.stat().st_mode & 0o777 == 0o777 & ~_umask()


def test_what_ends_badly_leaves_what_stood(tmp_path: Path) -> None:
    place = tmp_path / "deep" / "run"
    with pytest.raises(ZeroDivisionError), draft_of(place, replacing=False):
        _ = 1 / 0
    assert names(tmp_path) == []
    with draft_of(place, replacing=False) as draft:
        (draft / "a").write_text("old")
    with pytest.raises(KeyboardInterrupt), draft_of(place, replacing=True) as draft:
        (draft / "a").write_text("new")
        raise KeyboardInterrupt
    assert (place / "a").read_text() == "old" and names(place.parent) == ["run"]


def test_a_writer_is_not_disturbed_and_a_killed_one_s_leftovers_go(tmp_path: Path) -> None:
    place = tmp_path / "run"
    with subprocess.Popen([sys.executable, "-c", WRITER, str(place)], stdout=-1, text=True) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        (theirs,) = names(tmp_path)
        with pytest.raises(LabError, match="is being written by another run"), draft_of(place, replacing=False):
            pass
        assert names(tmp_path) == [theirs] and names(tmp_path / theirs) == ["a"]
        writer.send_signal(signal.SIGKILL)
        writer.wait()
    assert names(tmp_path) == [theirs]  # what a killed one leaves
    with draft_of(place, replacing=False) as draft:  # which is no earlier run
        (draft / "b").write_text("")
    assert names(tmp_path) == ["run"] and names(place) == ["b"]


def test_a_run_that_was_moved_aside_when_the_writer_was_killed_comes_back(tmp_path: Path) -> None:
    (tmp_path / ".run.replaced-x").mkdir()
    (tmp_path / ".run.replaced-x" / "a").write_text("earlier")
    (tmp_path / ".other.partial-y").mkdir()
    with pytest.raises(ZeroDivisionError), draft_of(tmp_path / "run", replacing=True):
        assert (tmp_path / "run" / "a").read_text() == "earlier"
        _ = 1 / 0
    assert names(tmp_path) == [".other.partial-y", "run"] and names(tmp_path / "run") == ["a"]


def test_leftovers_of_killed_processes_beside_a_new_folder_are_put_back_or_removed(tmp_path: Path) -> None:
    left = (".gone.replaced-a_1", ".there.replaced-b", ".there.partial-c", ".new.partial-d", "there", ".hidden")
    for name in left:
        (tmp_path / name).mkdir()
        if name != ".new.partial-d":  # another process may be about to lock it
            os.utime(tmp_path / name, (0, 0))
    with draft_of(tmp_path / "busy", replacing=False) as draft:
        os.utime(draft, (0, 0))  # locked, however old
        with draft_of(tmp_path / "run", replacing=False):
            pass
        assert draft.is_dir()
    assert names(tmp_path) == [".hidden", ".new.partial-d", "busy", "gone", "run", "there"]


def test_an_interruption_while_what_was_replaced_goes_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, asked = shutil.rmtree, list[Path]()

    def interrupted(folder: Path, *, ignore_errors: bool = False) -> None:
        asked.append(folder)
        if ".replaced-" in folder.name and len(asked) == 1:
            raise KeyboardInterrupt
        plain(folder, ignore_errors=ignore_errors)

    (tmp_path / "run").mkdir()
    monkeypatch.setattr(shutil, "rmtree", interrupted)
    with pytest.raises(KeyboardInterrupt), draft_of(tmp_path / "run", replacing=True) as draft:
        (draft / "new").write_text("")
    assert names(tmp_path) == ["run"] and names(tmp_path / "run") == ["new"]


def test_nothing_is_replaced_unless_it_is_said(tmp_path: Path) -> None:
    """What stands, what a killed process had moved aside, and what another one writes meanwhile."""
    place = tmp_path / "run"
    (tmp_path / ".run.replaced-x").mkdir()
    (tmp_path / ".run.replaced-x" / "a").write_text("earlier")
    for _ in range(2):
        with pytest.raises(LabError, match="holds an earlier run; add --overwrite"), draft_of(place, replacing=False):
            raise AssertionError("nothing is to begin")
        assert names(tmp_path) == ["run"] and (place / "a").read_text() == "earlier"
    (place / "a").unlink()
    with draft_of(place, replacing=False) as draft:  # an empty folder is none
        (draft / "b").write_text("")
    other = tmp_path / "other"
    with pytest.raises(LabError, match="holds an earlier run"), draft_of(other, replacing=False):
        other.mkdir()
        (other / "c").write_text("")
    assert names(tmp_path) == ["other", "run"] and names(other) == ["c"]


def test_one_at_a_time(tmp_path: Path) -> None:
    with held(tmp_path), pytest.raises(LabError, match="is being written by another run"), held(tmp_path):
        pass
    with held(tmp_path):
        pass


def test_checksums_tell_what_was_changed_added_or_removed(tmp_path: Path) -> None:
    for name in "abc":
        (tmp_path / name).write_text(name)
    lines = checksum_lines(tmp_path)
    assert edited_files(tmp_path, lines, ("a", "b", "c")) == ()
    (tmp_path / "a").write_text("A")
    (tmp_path / "b").unlink()
    (tmp_path / "d").write_text("")
    assert edited_files(tmp_path, lines, ("a", "b", "c", "d")) == ("a", "b", "d")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_an_interruption_as_the_draft_is_made_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = Path.mkdir

    def made(self: Path, *given: object, **named: object) -> None:
        usual(self, *given, **named)  # type: ignore[arg-type]
        if ".partial-" in self.name:
            raise KeyboardInterrupt

    monkeypatch.setattr(Path, "mkdir", made)
    with pytest.raises(KeyboardInterrupt), draft_of(tmp_path / "runs" / "run", replacing=False):
        pass
    assert names(tmp_path) == []
