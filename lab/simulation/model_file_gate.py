"""What an MJCF or a URDF may hold, checked before MuJoCo reads it: sizes, finite numbers, files that are files.

MuJoCo itself takes any size of a texture, of a height field and of what is replicated, and writes a log into the
working folder where a number is not finite.
"""

import stat
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from math import prod
from pathlib import Path

from lab.core.errors import LabError
from lab.core.limits import COPIES, JOINTS, MESH_BYTES, NESTED_ELEMENTS, PIXELS, TEXT_BYTES
from lab.formats.text_file import read_bytes
from lab.formats.urdf_source import is_urdf, mesh_files

__all__ = ["model_files", "refuse_unbounded_model"]

_AREAS = {"texture": ("width", "height"), "hfield": ("nrow", "ncol"), "replicate": ("count",), "composite": ("count",)}
_AREAS |= {"flexcomp": ("count",)}
_NOT_FINITE = frozenset(("nan", "inf", "infinity"))
_TEXTS = frozenset(("name", "file", "filename", "class", "childclass", "model", "link", "joint", "body", "site"))


def refuse_unbounded_model(path: Path) -> None:
    """Refuse a model of more than can be worked with; what is wrong with it otherwise, MuJoCo tells.

    Raises:
        LabError: it is too large, nests too deeply, reads what is no file, or has a number that is not finite.
    """
    joints, sizes = 0, dict[Path, int]()
    folders = {path.parent}
    for element, depth in _elements(path):
        NESTED_ELEMENTS(path, depth)
        _refuse_numbers(path, element)
        if element.tag in _AREAS:
            most = PIXELS if len(_AREAS[element.tag]) == 2 else COPIES
            most(f"{path}: {element.tag}", _product(element, _AREAS[element.tag]))
        folders |= _folders(path, element)
        joints += element.tag == "joint" and element.get("type") != "fixed"
        sizes |= _sizes(path, folders, element.get("file") or element.get("filename"))
    JOINTS(path, joints)
    MESH_BYTES(path, sum(sizes.values()))


def model_files(path: Path) -> set[Path]:
    """The files that a model names, as far as they are there: meshes, pictures, included models.

    Raises:
        LabError: it cannot be read.
    """
    if is_urdf(path):
        return set(mesh_files(path))
    elements = [element for element, _ in _elements(path)]
    folders = {path.parent}.union(*(_folders(path, each) for each in elements))
    named = [each.get("file") for each in elements]
    return {folder / name for folder in folders for name in named if name is not None and (folder / name).is_file()}


def _folders(path: Path, element: ET.Element) -> set[Path]:
    """Folders in which an element says that files are."""
    return {path.parent / element.get(each, "") for each in ("meshdir", "texturedir", "assetdir")}


def _elements(path: Path) -> Iterator[tuple[ET.Element, int]]:
    """Every element with its depth, those of included files too."""
    waiting, read = [path], set[Path]()
    while waiting:
        file = waiting.pop()
        if file in read or not file.exists():
            continue
        read.add(file)
        root = _root(file)
        left = [(root, 1)]
        while left:
            element, depth = left.pop()
            yield element, depth
            left.extend((child, depth + 1) for child in element)
            if element.tag == "include" and (name := element.get("file")):
                waiting.append(path.parent / name)


def _root(file: Path) -> ET.Element:
    """The outermost element: what this parser cannot read, MuJoCo's might, and nothing of it would be checked."""
    content = read_bytes(file, TEXT_BYTES)
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, LookupError, ValueError) as error:  # the last two of an encoding that there is not
        said = error if content.strip() else "an empty file"
        raise LabError(f"{file}: not a readable MJCF or URDF, mend it there: {said}") from error
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:  # MuJoCo takes names as bytes
        if any(not value.isascii() for element in root.iter() for value in element.attrib.values()):
            raise LabError(f"{file}: has names that are not in UTF-8; save it as UTF-8") from error
    return root


def _refuse_numbers(path: Path, element: ET.Element) -> None:
    for name, text in element.items():
        if name not in _TEXTS and any(word.lower().lstrip("+-") in _NOT_FINITE for word in text.split()):
            raise LabError(f"{path}: {element.tag}: {name} is '{text}'; give finite numbers")


def _product(element: ET.Element, names: Sequence[str]) -> int:
    """Of all numbers in some attributes; what is no number, MuJoCo tells."""
    words = [word for name in names for word in element.get(name, "1").split()]
    try:
        return prod(max(1, int(float(word))) for word in words)
    except (ValueError, OverflowError):
        return 1


def _sizes(path: Path, folders: set[Path], name: str | None) -> dict[Path, int]:
    """The sizes of the files that an element names, wherever they are."""
    sizes = {}
    for file in () if name is None else {folder / name for folder in folders}:
        try:
            found = file.stat()
        except (OSError, ValueError):
            continue
        if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
            raise LabError(f"{path}: {name} is no regular file; give a file")
        sizes[file] = found.st_size
    return sizes
