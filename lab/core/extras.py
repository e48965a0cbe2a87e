"""Import optional packages; one that is not installed is an error of one line that names the extra to install."""

from importlib import import_module
from typing import Any, Final

from lab.core.errors import LabError

__all__ = ["how_to_install", "optional"]

_DISTRIBUTION: Final = "virtual-calibration-lab"
_EXTRAS: Final = {  # of pyproject.toml, by the module that they bring
    "matplotlib": "plots",
    "sympy": "symbolic",
    "cv2": "camera",
    "distributed": "cluster",
    "robot_descriptions": "robots",
    "rerun_notebook": "notebook",
}
_PACKAGES: Final = {"rerun": "rerun-sdk", "yaml": "pyyaml"}  # whose name is not the module's


def optional(module: str, needed_for: str) -> Any:
    """Import a module of an optional package.

    Args:
        needed_for: what needs it, as the message begins.

    Raises:
        LabError: it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) and error.name else module
        raise LabError(f"{needed_for} needs {how_to_install(missing)}") from error


def how_to_install(module: str) -> str:
    """Describe a package that is missing, and the command that installs it."""
    name = module.partition(".")[0]
    extra = _EXTRAS.get(name)
    package = f"'{_DISTRIBUTION}[{extra}]'" if extra else _PACKAGES.get(name, name)
    return f"{name}, which is not installed; pip install {package}"
