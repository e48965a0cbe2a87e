from pathlib import Path

import numpy as np
import pytest

from lab.core import whole_folder as kept_pieces
from lab.core.whole_folder import Columns, Pieces, at_once, current_keep, keeping, of_one, read_checked

A, B = np.arange(4.0), np.asfortranarray(np.arange(6.0).reshape(2, 3))


@pytest.fixture(autouse=True)
def worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_pieces, "_MIN_CPU_S", -1.0)


class Work:
    """Counts how often a piece is made."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> Columns:
        self.times += 1
        return {"reals": B / 3, "texts": np.array(["", "é, x"]), "none": np.empty((0, 2)), "one": np.array(np.nan)}


def pieces(folder: Path) -> Pieces:
    return Pieces(folder / "kept", "work.json", b"{}")


def test_a_piece_is_made_once_and_comes_back_as_it_was(tmp_path: Path) -> None:
    work = Work()
    first = pieces(tmp_path)("stage", [A], work)
    again = pieces(tmp_path)("stage", [A.copy()], work)
    assert work.times == 1 and list(first) == list(again)
    for name, values in first.items():
        np.testing.assert_array_equal(again[name], values, strict=True)
        assert again[name].flags.f_contiguous == values.flags.f_contiguous


@pytest.mark.parametrize(
    ("stage", "of"),
    [("other", [A]), ("stage", [A + 1e-300]), ("stage", [A.astype(np.float32)]), ("stage", [A[:2], A[2:]]),
     ("stage", [A.reshape(2, 2)])],
)  # fmt: skip
def test_a_piece_of_anything_else_is_another(stage: str, of: list[np.ndarray], tmp_path: Path) -> None:
    work = Work()
    pieces(tmp_path)("stage", [A + 0.0], work)
    pieces(tmp_path)(stage, of, work)
    assert work.times == (1 if of[0].tobytes() == A.tobytes() and of[0].shape == A.shape and stage == "stage" else 2)


def test_pieces_of_two_robots_are_two(tmp_path: Path) -> None:
    work = Work()
    for name in ("one", "two", "one"):
        of_one(pieces(tmp_path), name)("stage", [A], work)
    assert work.times == 2


@pytest.mark.parametrize("damage", ["cut", "bit", "no sum", "empty"])
def test_a_damaged_piece_is_made_again(damage: str, tmp_path: Path) -> None:
    work = Work()
    pieces(tmp_path)("stage", [A], work)
    (path,) = (tmp_path / "kept").glob("*.npz")
    content = path.read_bytes()
    if damage == "no sum":
        path.with_suffix(".sha256").unlink()
    else:
        path.write_bytes({"cut": content[:-9], "bit": bytes([content[0] ^ 1]) + content[1:], "empty": b""}[damage])
    assert read_checked(path) is None
    pieces(tmp_path)("stage", [A], work)
    assert work.times == 2 and read_checked(path) == content


def test_what_takes_no_time_or_has_no_room_is_done_and_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = Work()
    (tmp_path / "kept").write_text("no folder")
    full = pieces(tmp_path)
    full("stage", [A], work)
    assert work.times == 1 and not full.kept
    monkeypatch.setattr(kept_pieces, "_MIN_CPU_S", 5.0)
    quick = Pieces(tmp_path / "quick", "work.json", b"{}")
    quick("stage", [A], work)
    assert work.times == 2 and not quick.kept and not (tmp_path / "quick").exists()


def test_nothing_is_kept_where_nobody_asked_for_it(tmp_path: Path) -> None:
    assert current_keep() is at_once
    keep = pieces(tmp_path)
    with keeping(keep):
        assert current_keep() is keep
    assert current_keep() is at_once
