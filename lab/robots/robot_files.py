"""Find the lab's own robots, and compute digests of robots' files."""

import hashlib
import io
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from pathlib import Path

from lab.core.errors import LabError, option_name
from lab.core.extras import how_to_install

__all__ = ["description_of", "ends_of", "is_own", "joined", "models_folder", "own_models", "parted", "sha256_of"]

_MAIN = ("mechanism.toml", "scene.xml", "robot.xml", "robot.toml")  # a folder's own description: the first there is
_DRIVES = "drives.toml"  # beside a description, for ``lab dynamics --drives``: no robot, and no part of its model


def parted(robot: str) -> tuple[str, str]:
    """Split the reference of a robot into its name or path, and the rest from ``#`` on, as ``joined`` wrote it."""
    if "#" not in robot or Path(robot).exists():
        return robot, ""
    name, _, rest = robot.rpartition("#")
    return name, f"#{rest}"


def joined(robot: str, base: str, tips: Sequence[str]) -> str:
    """Return the reference of a robot whose chains run from a base to tips: ``torso.urdf#pelvis:left,right``.

    Raises:
        LabError: the robot is a reference with a base or tips already, or a name cannot be part of one.
    """
    if not base and not tips:
        return robot
    if parted(robot)[1]:
        raise LabError(f"robot '{robot}' names its tips already; give them once")
    for name in (base, *tips):
        if set(name) & set("#:,"):
            raise LabError(f"'{name}' cannot name a base or a tip: it has one of # : , in it")
    if "" in tips:
        raise LabError(f"{option_name('tip')}: an empty name; name a body, a link or a site")
    if len(set(tips)) < len(tips):
        raise LabError(f"{option_name('tip')}: {', '.join(tips)}: name each tip once")
    return f"{robot}#{f'{base}:' if base else ''}{','.join(tips)}"


def ends_of(reference: str) -> tuple[str, tuple[str, ...]]:
    """Return base ("" for the world) and tips of the second part of a reference."""
    base, _, tips = reference.removeprefix("#").rpartition(":")
    return base, tuple(tip for tip in tips.split(",") if tip)


def models_folder() -> Path:
    """Return the folder of the robots: in the installed package, or beside it in a checkout."""
    installed = Path(__file__).resolve().parents[1] / "models"
    return installed if installed.is_dir() else installed.parent.parent / "models"


def own_models() -> dict[str, Path]:
    """Return the lab's own robots by name.

    A folder's name is that of its description. Its other descriptions are ``<folder>/<file>``. Where there are no more
    than those, as in a maker's folder, each is also named by its file alone, unless another robot has that name.
    """
    return dict(_models_in(models_folder()))


@cache
def _models_in(models_folder: Path) -> dict[str, Path]:
    models, alone = dict[str, Path](), list[Path]()
    for folder in sorted(path for path in models_folder.iterdir() if (path / "README.md").is_file()):
        main = next((folder / name for name in _MAIN if (folder / name).is_file()), None)
        others = [path for path in sorted(folder.glob("*.toml")) if path.name not in (*_MAIN, _DRIVES)]
        if main is None:
            alone += others
        else:
            models[folder.name] = main
        models |= {f"{folder.name}/{path.stem}": path for path in others}
    named = Counter(path.stem for path in alone)
    return models | {path.stem: path for path in alone if path.stem not in models and named[path.stem] == 1}


_SHOWN = 5  # names in a message
_USUAL = ("irb120", "ur5e", "panda", "kr6_r900", "scara")


def description_of(robot: str) -> Path:
    """Return the file that describes a robot: a name of the lab's own, a path, or a name of ``robot_descriptions``.

    Raises:
        LabError: there is none (the message has the nearest names).
    """
    models = own_models()
    path = models.get(robot, Path(robot))
    if path.suffix in (".xml", ".urdf", ".toml") and path.is_file():
        return path
    if path.suffix == ".xacro" and path.is_file():
        urdf = path.with_suffix("" if path.stem.endswith(".urdf") else ".urdf")
        raise LabError(f"robot '{robot}' is a xacro; expand it first (xacro {path} > {urdf}), and give {urdf}")
    if robot.endswith("_description") and robot.isidentifier() and not path.exists():
        return _downloaded(robot)
    raise LabError(f"robot '{robot}': {_unknown_note(robot, path, models)}")


def _unknown_note(robot: str, path: Path, models: Mapping[str, Path]) -> str:
    """Describe what is wrong with the name or path of a robot, and which names are near."""
    why = "neither MJCF, URDF nor TOML" if path.exists() else "no such model or file"
    near = get_close_matches(robot.lower().replace("-", "_"), models, 1, cutoff=0.75)
    meant = f" (is {near[0]} meant?)" if near and not path.exists() else ""
    names = list({path: name for name, path in models.items()}.values())  # the shortest of each
    shown = list(dict.fromkeys([*get_close_matches(robot.lower(), names, _SHOWN, cutoff=0.5), *_USUAL]))[:_SHOWN]
    return (
        f"{why}{meant}; there are {', '.join(shown)} and {len(names) - len(shown)} others (the page "
        "Robots of the documentation lists them), or give a path to .xml, .urdf or .toml"
    )


def _downloaded(name: str) -> Path:
    """Return the MJCF or URDF of a name of the package ``robot_descriptions``, if it was downloaded before."""
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), _without_downloads():
            module = import_module(f"robot_descriptions.{name}")
    except ModuleNotFoundError as error:
        if error.name == f"robot_descriptions.{name}":
            raise LabError(f"robot '{name}': the package robot_descriptions has no such description") from None
        raise LabError(
            f"robot '{name}': needs {how_to_install('robot_descriptions')}, or give a path to .xml, .urdf or .toml"
        ) from None
    except Exception as error:  # of any kind, from git
        raise LabError(
            f"robot '{name}': is not on this machine; download it first: robot_descriptions pull {name}"
        ) from error
    for kind in ("MJCF_PATH", "URDF_PATH"):
        if (path := Path(getattr(module, kind, ""))).is_file():
            return path
    if xacro := getattr(module, "XACRO_PATH", ""):
        raise LabError(f"robot '{name}' is a xacro; expand it first (xacro {xacro} > robot.urdf), and give robot.urdf")
    raise LabError(f"robot '{name}': has neither an MJCF nor a URDF that is a file; give a path to one")


@contextmanager
def _without_downloads() -> Iterator[None]:
    """Let git use what is on this machine alone: the package downloads what it misses when it is imported."""
    variable, protocols = "GIT_ALLOW_PROTOCOL", os.environ.get("GIT_ALLOW_PROTOCOL")
    os.environ[variable] = "file"
    try:
        yield
    finally:
        if protocols is None:
            del os.environ[variable]
        else:
            os.environ[variable] = protocols


def is_own(path: Path) -> bool:
    """Decide whether a file belongs to one of the lab's own robots."""
    return path.parent.parent == models_folder()


def sha256_of(path: Path) -> str:
    """Return the digest of a model's folder without its README and drives, or of a single file.

    A folder without a description of its own, as a maker's, is a shelf: each of its files is a robot by itself.
    """
    digest = hashlib.sha256()
    files = [path]
    if is_own(path) and any((path.parent / name).is_file() for name in _MAIN):
        every = sorted(path.parent.rglob("*"))
        files = [p for p in every if p.suffix in (".xml", ".stl", ".toml") and p.name != _DRIVES]
    for file in files:
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
