"""Results of commands that have no document yet: how each is written and printed."""

from pathlib import Path
from typing import Any

from lab.commands.result import Result


def write(folder: Path, name: str, result: Any) -> None:
    """Write all files of a run."""
    if isinstance(result, Result):
        return result.write(folder)
    globals()[f"_write_{name}"](folder, result)
    return None


def exit_code(name: str, result: Any) -> int:
    """Whether the answer is good."""
    if isinstance(result, Result):
        return result.exit_code
    return 0


def tell(name: str, result: Any, place: Path | None) -> None:
    """Print a result for a person."""
    if isinstance(result, Result):
        from lab.render.terminal import print_document

        print_document(result.document(), warnings=False)
        if place is not None:
            print(f"run: {place}")
        return
    globals()[f"_tell_{name}"](result, place)


def warnings(name: str, result: Any) -> Any:
    """What a reader should be told."""
    return () if name == "study" else result.warnings


def values(name: str, result: Any) -> Any:
    """What ``--json`` prints."""
    if isinstance(result, Result):
        return result.to_dict()
    if name == "study":
        return result.summary
    raise AssertionError(name)


def _tell_study(done: Any, place: None) -> None:
    from lab.commands.study.report import analysis_of, print_study

    print_study(done, analysis_of(done))
