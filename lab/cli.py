"""The command line: arguments in, a call of the library, its result out.

Exit code 0: done; 1: the answer is bad; 2: the input is bad; 130: interrupted.
"""

import contextlib
import io
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import lab
from lab.commands.registry import COMMANDS, Command, command_named
from lab.core.errors import LabError

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit code."""
    try:
        code = _run(sys.argv[1:] if arguments is None else list(arguments))
        sys.stdout.flush()
        return code
    except LabError as error:
        return _fail(str(error), 2)
    except OSError as error:  # of files the library tells; what is left is the output
        sys.stdout = io.StringIO()  # so that Python does not try once more when it ends
        return _fail(f"the output cannot be written ({error.strerror}); look where it goes", 2)
    except KeyboardInterrupt as stop:
        return _fail(f"interrupted; {stop or 'nothing was written'}", 130)


def _fail(why: str, code: int) -> int:
    print(f"lab: {why}", file=sys.stderr)
    return code


def _run(arguments: list[str]) -> int:
    if not arguments:
        raise LabError(f"give a command: {', '.join(each.name for each in COMMANDS)}; see lab --help")
    if arguments[0] in ("-h", "--help"):
        print(_help())
        return 0
    if arguments[0] == "--version":
        print(f"lab {lab.__version__}")
        return 0
    return _run_command(command_named(arguments[0]), arguments[1:])


def _help() -> str:
    """What there is; written here, so that no parser has to be loaded for it."""
    width = max(len(each.name) for each in COMMANDS) + 2
    return "\n".join(
        [
            "usage: lab COMMAND [OPTIONS]",
            "",
            (lab.__doc__ or "").partition("\n")[0],
            "",
            "commands:",
            *(f"  {each.name:{width}}{each.help}" for each in COMMANDS),
            "",
            "lab COMMAND --help lists the options of a command; lab --version prints the version.",
        ]
    )


def _run_command(command: Command, arguments: list[str]) -> int:
    """Run, write and print; the exit code is the result's."""
    from threadpoolctl import threadpool_limits

    from lab.commands.command_line import parsed
    from lab.commands.run_folder import free_name, input_files, run_folder

    asked, place = parsed(command, arguments), None
    with contextlib.ExitStack() as stack:
        stack.enter_context(threadpool_limits(1))  # small matrices: more threads wait for each other
        if command.folder:
            place = asked.out or free_name(Path("runs"), command.folder_name(asked.options))
            folder = stack.enter_context(run_folder(place, input_files(asked.options)))
        result = command(asked.options)
        if command.folder:
            result.write(folder)
    for warning in result.warnings:
        print(f"lab: warning: {warning}", file=sys.stderr)
    if asked.json:
        print(json.dumps(result.to_dict(), allow_nan=False))
    else:
        from lab.render.terminal import print_document

        print_document(result.document(), warnings=False)
        if place is not None:
            print(f"run: {place}")
    return result.exit_code
