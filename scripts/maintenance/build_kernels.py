"""Compiles the kinematic kernels, where there is a C compiler; pip runs it, and so can you after a change.

    python scripts/maintenance/build_kernels.py

Without a compiler, or where it fails, the package is complete all the same: numpy does what the kernels would do.
"""

import argparse
import hashlib
import os
import platform
import shlex
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # run by hand
    BuildHookInterface = object

FOLDER = Path(__file__).resolve().parents[2] / "lab" / "kinematics" / "compiled"
BUILT = "machine_code.pyd" if os.name == "nt" else "machine_code.abi3.so"
FLAGS = ["-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC", "-w"]


def stable_tag() -> str:
    """The wheel's tag: the kernels use the stable ABI of Python 3.11, so that every later version takes them."""
    system = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    return f"cp311-abi3-{system}"


def apple_flags(platform_name: str) -> list[str]:
    """The flags of Apple's compiler for the processors and the oldest system that this platform's name promises."""
    _, oldest, processors = platform_name.split("-", 2)
    kinds = ("arm64", "x86_64") if processors == "universal2" else (processors,)
    each = [flag for kind in kinds for flag in ("-arch", kind)]
    return ["-undefined", "dynamic_lookup", f"-mmacosx-version-min={oldest}", *each]


def compiler() -> list[str]:
    """The compiler's command: ``$CC``, the one that built Python, or ``cc``."""
    return shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")


def build(folder: Path = FOLDER) -> str:
    """Compile the kernels in their folder; why that failed, or nothing.

    Kernels of the same sources, compiler and system stay: pip asks for them once for the metadata and once for the
    package.
    """
    built, stamp = folder / BUILT, folder / f"{BUILT}.sha256"
    made_of = [Path(__file__).read_text(), (folder / "kernels.c").read_text(), sysconfig.get_platform(), *compiler()]
    digest = hashlib.sha256("\n".join(made_of).encode()).hexdigest()
    if built.exists() and stamp.exists() and stamp.read_text() == digest:
        return ""
    failed = _compiled(folder, built)
    if failed:
        built.unlink(missing_ok=True)  # an earlier one belongs to other sources
        stamp.unlink(missing_ok=True)
    else:
        stamp.write_text(digest)
    return failed


def _compiled(folder: Path, built: Path) -> str:
    if platform.python_implementation() != "CPython":
        return "the kernels are compiled for CPython alone"
    if os.name == "nt":
        return _compiled_on_windows(folder)
    include, there = sysconfig.get_path("include"), folder / f"machine_code.{os.getpid()}.tmp"
    more = apple_flags(sysconfig.get_platform()) if sys.platform == "darwin" else []
    command = [*FLAGS, *more, f"-I{include}", str(folder / "kernels.c"), "-o", str(there), "-lm"]
    said = ""
    for first in dict.fromkeys([tuple(compiler()), ("cc",), ("gcc",)]):
        try:
            done = subprocess.run([*first, *command], capture_output=True, text=True, timeout=300)
        except (OSError, subprocess.TimeoutExpired) as error:
            said = said or str(error)
            continue
        if done.returncode == 0:
            there.replace(built)
            return ""
        said = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[0]
    there.unlink(missing_ok=True)
    return said


def _compiled_on_windows(folder: Path) -> str:
    """Let setuptools find Microsoft's compiler and Python's library."""
    try:
        from setuptools import Distribution, Extension
        from setuptools.command.build_ext import build_ext

        flags = ["/O2", "/std:c11", "/fp:precise"]
        kernels = Extension("machine_code", [str(folder / "kernels.c")], py_limited_api=True, extra_compile_args=flags)
        command = build_ext(Distribution({"ext_modules": [kernels]}))
        command.build_lib, command.build_temp = str(folder), tempfile.mkdtemp()
        command.ensure_finalized()
        command.run()
    except Exception as error:  # whatever is missing: numpy does the work
        return str(error) or type(error).__name__
    return ""


class KernelHook(BuildHookInterface):  # type: ignore[misc]
    """Compiles before a wheel or an editable install is made."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """A wheel with kernels is for this machine's kind, one without for all."""
        failed = build()
        if failed:
            self.app.display_warning(f"kernels not compiled, numpy does their work: {failed}")
            return
        build_data["pure_python"], build_data["tag"] = False, stable_tag()
        build_data["artifacts"].append(f"lab/kinematics/compiled/{BUILT}")


def main() -> None:
    """Compile by hand."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    failed = build()
    print(f"not compiled: {failed}" if failed else f"compiled into {FOLDER}")


if __name__ == "__main__":
    main()
