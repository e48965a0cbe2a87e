"""Find the lab's own robots, and compute digests of robots' files."""

import hashlib
from pathlib import Path

from lab.core.errors import LabError

__all__ = ["description_of", "is_own", "models_folder", "own_models", "sha256_of"]

_DESCRIPTION = "mechanism.toml"
_DRIVES = "drives.toml"  # beside a description, for ``lab dynamics --drives``: no robot, and no part of its model


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
