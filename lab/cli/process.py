"""Process environment of a command: its streams, its interruption, and the log of internal errors."""

import codecs
import io
import json
import os
import shutil
import sys
import textwrap
import traceback
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

from lab.core.errors import was_interrupted

__all__ = [
    "CLOSED", "DEFECT", "INTERRUPTED", "drop_output", "interruptible", "leave", "output_may_close", "plain_streams",
    "say", "say_as_json", "write_log",
]  # fmt: skip

DEFECT, INTERRUPTED = 70, 130  # exit codes: EX_SOFTWARE of sysexits.h; 128 + SIGINT
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
CLOSED = 0  # where the reader closed the output
_LONGEST_LINE = 1000  # characters of a message: a name or a cell may have a million
_ENCODING_ERRORS = "lab.plain"
_PLAIN = {"−": "-", "→": "->", "±": "+-", "σ": "sigma", "χ": "chi", "µ": "u", "·": "*", "×": "x", "°": "deg", "≤": "<="}


def _transliterated(error: UnicodeError) -> tuple[str, int]:
    """Characters that an output's encoding lacks, as plain ones: a handler of encoding errors."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    found = []
    for character in error.object[error.start : error.end]:
        near = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
        found.append(_PLAIN.get(character) or near or "?")
    return "".join(found), error.end


def plain_streams() -> None:
    """Transliterate characters that the encoding of standard output or error lacks.

    A stream that was closed before the program began leads to the null device: no other file may get its number.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(_nowhere(number), "r" if number == 0 else "w", encoding="utf-8"))
    codecs.register_error(_ENCODING_ERRORS, _transliterated)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_ENCODING_ERRORS)


def _nowhere(number: int) -> int:
    """Open the null device as this unused file descriptor."""
    opened = os.open(os.devnull, os.O_RDWR)
    if opened != number:
        os.dup2(opened, number)
        os.close(opened)
    return number


def say(message: str) -> None:
    """Print one line on standard error: control characters are escaped, the middle of a long line is cut."""
    line = " ".join(message.split())
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
    if len(line) > _LONGEST_LINE:
        line = f"{line[: _LONGEST_LINE // 2]} … {line[-_LONGEST_LINE // 2 :]}"
    line = f"lab: {line}"
    if sys.stderr.isatty():  # a terminal would break words
        width = shutil.get_terminal_size().columns
        line = textwrap.fill(line, width, break_on_hyphens=False, break_long_words=False)
    with suppress(OSError):  # nobody reads it
        print(line, file=sys.stderr, flush=True)


def say_as_json(message: str, code: int) -> None:
    """Print an error as one JSON object on standard output, for programs that read results there."""
    with suppress(OSError):
        print(json.dumps({"error": {"message": message, "exit_code": code}}), flush=True)


@contextmanager
def output_may_close() -> Iterator[None]:
    """Drop the rest of the output without an error where its reader closes it."""
    try:
        try:
            yield
        except SystemExit:  # after help was printed
            _flush()
            raise
        _flush()
    except (OSError, SystemExit) as stop:
        if not _closed_output(stop):
            raise
        drop_output()


def _flush() -> None:
    if sys.stdout is not None:
        sys.stdout.flush()


def _closed_output(error: BaseException) -> bool:
    """Decide whether an error is, or came of, a closed output: rich then ends the program."""
    return isinstance(error, BrokenPipeError) or isinstance(error.__context__, BrokenPipeError)


def drop_output() -> None:
    """Send further standard output to the null device: Python would try once more when it ends."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
    sys.stdout = io.StringIO()


@contextmanager
def interruptible() -> Iterator[list[int]]:
    """Deliver an interruption within the block wherever it comes; ignore it after the block, as the program ends.

    A request to end (SIGTERM) and a closed terminal (SIGHUP) are interruptions too, unless the program that started
    this one has them ignored, as nohup does. The yielded list holds the signals that came: then the program ends by
    ``leave``, as what was interrupted inside libraries is not safe to be taken down.
    """
    import _thread
    import signal
    import threading

    def passed_on(unraisable: Any) -> None:  # of a destructor or a callback, from which nothing can be raised
        if was_interrupted(unraisable.exc_value):
            threading.Timer(0.01, _thread.interrupt_main).start()  # here it would be raised in vain, too

    came = list[int]()

    def stop(number: int, _: object) -> None:
        came.append(number)
        raise KeyboardInterrupt

    os.environ.setdefault("MUJOCO_GL", "disable")  # nothing opens a window; to look for one starts another process
    usual: Callable[[Any], Any] = sys.unraisablehook
    sys.unraisablehook = passed_on
    ending = [each for name in _ENDING if (each := getattr(signal, name, None))]  # Windows has no SIGHUP
    ending = [each for each in ending if signal.getsignal(each) in (signal.SIG_DFL, signal.default_int_handler)]
    for each in ending:
        signal.signal(each, stop)
    try:
        yield came
    finally:
        sys.unraisablehook = usual
        for each in ending:
            signal.signal(each, signal.SIG_IGN)


def leave(code: int) -> NoReturn:
    """End the program with this exit code, without taking anything down: libraries may have been left half-way."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(code)


def write_log(arguments: list[str], error: BaseException) -> str:
    """Write a traceback into a new temporary file; return its path, or "" if it cannot be written."""
    import tempfile

    from lab.core.version import __version__

    lines = [f"lab {__version__}, Python {sys.version}\n", f"arguments: {arguments!r}\n\n"]
    lines += traceback.format_exception(error)
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", errors="backslashreplace", prefix="lab-defect-", suffix=".log", delete=False
        ) as file:
            file.writelines(lines)
            return file.name
    except OSError:
        return ""
