"""Find the lab's own robots, and compute digests of robots' files."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from lab.core.errors import LabError, option_name

__all__ = ["description_of", "ends_of", "is_own", "joined", "models_folder", "own_models", "parted", "sha256_of"]

_DESCRIPTION = "mechanism.toml"
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
    """Return the lab's own robots by name: a folder's, and ``<folder>/<file>`` of its other descriptions."""
    found = dict[str, Path]()
    for folder in sorted(path for path in models_folder().iterdir() if (path / "README.md").is_file()):
        files = [folder / name for name in (_DESCRIPTION, "scene.xml", "robot.xml", "robot.toml")]
        main = next((path for path in files if path.is_file()), None)
        found |= {} if main is None else {folder.name: main}
        others = [path for path in sorted(folder.glob("*.toml")) if path not in files and path.name != _DRIVES]
        found |= {f"{folder.name}/{path.stem}": path for path in others}
    return found


def description_of(robot: str) -> Path:
    """Return the file that describes a robot, given by a name of the lab's own or by a path.

    Raises:
        LabError: there is none (the message lists those there are).
    """
    models = own_models()
    path = models.get(robot, Path(robot))
    if path.suffix in (".xml", ".urdf", ".toml") and path.is_file():
        return path
    if path.suffix == ".xacro" and path.is_file():
        urdf = path.with_suffix("" if path.stem.endswith(".urdf") else ".urdf")
        raise LabError(f"robot '{robot}' is a xacro; expand it first (xacro {path} > {urdf}), and give {urdf}")
    why = "neither MJCF, URDF nor TOML" if path.exists() else "no such model or file"
    raise LabError(f"robot '{robot}': {why}; there are {', '.join(models)}, or give a path to .xml, .urdf or .toml")


def is_own(path: Path) -> bool:
    """Decide whether a file belongs to one of the lab's own robots."""
    return path.parent.parent == models_folder()


def sha256_of(path: Path) -> str:
    """Return the digest of a model's folder without its README and drives, or of a single file."""
    digest = hashlib.sha256()
    files = [path]
    if is_own(path):
        every = sorted(path.parent.rglob("*"))
        files = [p for p in every if p.suffix in (".xml", ".stl", ".toml") and p.name != _DRIVES]
    for file in files:
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
