"""The command line: arguments in, a call of the library, its result out.

Exit code 0: done; 1: the answer is bad; 2: the input is bad; 3: a good answer is required and it is doubtful or not
judged; 70: an internal error; 130: interrupted. Each but 0 is explained in one line.
"""

import sys

TYPE_CHECKING = False  # an interruption is reported from the first line on: slow imports are inside ``main``
if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from typing import Any

    from lab.cli.command_line import Arguments
    from lab.library.result import Result
    from lab.options.command import Command

__all__ = ["main"]


def main(arguments: "Sequence[str] | None" = None) -> int:
    """Run one command; the exit code.

    Args:
        arguments: by default those that the program was started with.
    """
    try:
        if arguments is not None:
            return _ended(list(arguments))
        from lab.cli.process import interruptible, leave, plain_streams

        with interruptible() as came:
            plain_streams()
            _drop_unusable_date()
            _only_our_warnings()
            code = _ended(sys.argv[1:])
        if came:
            leave(code)
        return code
    except KeyboardInterrupt:  # before there was anything to write, or while it was reported
        print("lab: interrupted", file=sys.stderr, flush=True)
        if arguments is None:
            from lab.cli.process import leave

            leave(130)
        return 130


_MORE_HELP = (
    "lab COMMAND --help lists the usual options of a command, --help-all all of them; lab --version prints the "
    "version, lab --completion bash (or zsh, fish) a script that completes commands and options."
)


def _drop_unusable_date() -> None:
    """Unset a ``SOURCE_DATE_EPOCH`` that is no number: numpy cannot be imported whole with it."""
    import os

    if not os.environ.get("SOURCE_DATE_EPOCH", "0").isdecimal():
        del os.environ["SOURCE_DATE_EPOCH"]


def _only_our_warnings() -> None:
    """Show our warnings as such; hide those of libraries for programmers, unless python -W asks for them."""
    import warnings

    from lab.cli.process import say
    from lab.core.errors import LabWarning

    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        warnings.simplefilter("default", LabWarning)
    usual = warnings.showwarning

    def shown(message: "Warning | str", category: type[Warning], *where: "Any", **more: "Any") -> None:
        if issubclass(category, LabWarning):
            say(f"warning: {message}")
        else:
            usual(message, category, *where, **more)

    warnings.showwarning = shown


def _ended(arguments: list[str]) -> int:
    from lab.cli import process as program
    from lab.core.errors import LabError, options_as_flags, was_interrupted

    try:
        with program.output_may_close(), options_as_flags():
            return _run(arguments)
        return program.CLOSED
    except Exception as error:
        if was_interrupted(error) and not isinstance(error, LabError):
            program.say("interrupted; nothing was written")
            return program.INTERRUPTED
        message, code = _report_error(arguments, error)
        program.say(message)
        if "--json" in arguments:
            program.say_as_json(message, code)
        return code
    except KeyboardInterrupt as stop:
        program.say(f"interrupted; {str(stop) or 'nothing was written'}")
        return program.INTERRUPTED


def _report_error(arguments: list[str], error: Exception) -> tuple[str, int]:
    from lab.cli.process import DEFECT, drop_output, write_log
    from lab.core.errors import LabError

    if isinstance(error, LabError):
        return str(error), 2
    if isinstance(error, OSError):
        why = error.strerror or error
        if error.filename is not None:
            return f"{error.filename}: cannot be used ({why}); check it, or give another", 2
        drop_output()  # errors of files have names; what is left is the output
        return f"the output cannot be written ({why}); look where it goes", 2
    if isinstance(error, MemoryError):
        return "this needs more memory than there is; give fewer rows, poses, targets or joints", 2
    mujoco = sys.modules.get("mujoco")
    if mujoco is not None and isinstance(error, mujoco.FatalError):
        return f"MuJoCo cannot compute this model ({' '.join(str(error).split())}); mend the robot's or cell's file", 2
    log = write_log(arguments, error)
    kept = f"its traceback is in {log}: please report it with that file" if log else "no log of it could be written"
    return f"internal error ({type(error).__name__}: {error}); {kept}", DEFECT


def _run(arguments: list[str]) -> int:
    from lab.cli.commands import all_commands, command_named
    from lab.cli.process import output_may_close
    from lab.core.errors import LabError

    if not arguments:
        raise LabError(f"give a command: {', '.join(each.name for each in all_commands())}; see lab --help")
    if arguments[0] in ("-h", "--help", "--version"):
        import lab

        with output_may_close():
            print(f"lab {lab.__version__}" if arguments[0] == "--version" else _help())
        return 0
    if arguments[0] == "--completion":
        from lab.cli.command_line import print_completion

        with output_may_close():
            print_completion(" ".join(arguments[1:]))
        return 0
    return _run_command(command_named(arguments[0]), arguments[1:])


def _help() -> str:
    """Return the list of commands; written here, so that no parser has to be loaded for it."""
    import shutil
    import textwrap

    import lab
    from lab.cli.commands import all_commands, grouped_commands

    width = max(len(each.name) for each in all_commands()) + 2
    room, rest = max(40, shutil.get_terminal_size().columns), " " * (width + 2)
    lines = list[str]()
    for title, commands in grouped_commands().items():
        texts = (f"  {each.name:{width}}{each.help}" for each in commands)
        lines += [f"{title}:", *(textwrap.fill(text, room, subsequent_indent=rest) for text in texts), ""]
    return "\n".join(
        [
            "usage: lab COMMAND [OPTIONS]",
            "",
            textwrap.fill((lab.__doc__ or "").partition("\n")[0], room),
            "",
            *lines,
            textwrap.fill(_MORE_HELP, room, break_on_hyphens=False),
        ]
    )


def _refuse_incomplete(command: "Command", result: object) -> None:
    """Refuse what a command of another package returned, if it lacks what every result has."""
    from lab.core.errors import LabError
    from lab.library.result import Result

    start = f"lab {command.name}: {command.run} returns {type(result).__name__}"
    if not isinstance(result, Result):
        raise LabError(f"{start}; return a {Result.__module__}.Result")
    if missing := [name for name in ("command", "options", "warnings") if not hasattr(result, name)]:
        raise LabError(f"{start} without '{missing[0]}'; give it as a field, a property or an attribute of the class")


def _where(place: "Path") -> list[str]:
    from lab.report.terminal import linked

    page, recording = place / "report.html", place / "recording.rrd"
    return [
        f"run: {place}",
        *([f"page: {linked(page)}"] if page.is_file() else []),
        *([f"viewer: rerun {recording}"] if recording.is_file() else []),
    ]


def _run_command(command: "Command", arguments: list[str]) -> int:
    """Run, write and print; the exit code is the result's."""
    from lab.report.terminal import showing_progress, starting

    with starting(f"lab {command.name}"):
        from lab.cli.command_line import parsed
        from lab.cli.process import say

        command.load_options()
    requested = parsed(command, arguments)
    options = requested.options  # lab design has an option --check, so its own refusals are called otherwise
    if (check := getattr(options, "refuse_nonsense", None) or getattr(options, "check", None)) is not None:
        check()  # before there is a folder
    for note in requested.notes:
        say(note)
    own = getattr(options, "out", None)  # some commands write only where they are asked to
    before: list[tuple[Path, bytes]] = [] if own is None else [(own, _checksums(own))]
    try:
        with showing_progress(say):
            return _done(command, requested, before)
    except KeyboardInterrupt as stop:
        for place, checksums in before:
            if _checksums(place) not in (checksums, b""):  # it came too late
                raise KeyboardInterrupt(f"{place} was written before") from stop
        raise


def _checksums(place: "Path") -> bytes:
    """Return the checksums of the run in that folder; none where there is no run."""
    from lab.core.whole_folder import CHECKSUMS

    try:
        return (place / CHECKSUMS).read_bytes()
    except OSError:
        return b""


def _done(command: "Command", requested: "Arguments", before: "list[tuple[Path, bytes]]") -> int:
    """Run the command, and return the exit code.

    Args:
        before: filled with the run's folder, and the checksums of what stood there.
    """
    import contextlib
    import json
    from functools import partial
    from pathlib import Path

    from threadpoolctl import threadpool_limits

    from lab.cli.process import output_may_close, say
    from lab.core.errors import LabError
    from lab.core.gaps import attempted
    from lab.library.run_folder import complete, free_name, input_files, run_folder
    from lab.report.terminal import starting

    with contextlib.ExitStack() as stack:
        stack.enter_context(threadpool_limits(1))  # small matrices: more threads wait for each other
        stack.enter_context(contextlib.redirect_stdout(sys.stderr))  # what parts of packages print is no result
        place = requested.out
        if place is None and (name := command.folder_name(requested.options)):
            place = free_name(Path("runs"), name)
        if place is not None:
            before.append((place, _checksums(place)))
            folder = stack.enter_context(
                run_folder(place, input_files(requested.options), overwrite=requested.overwrite)
            )
        with starting(f"lab {command.name}"):  # its libraries take longer than its options
            run = command.load_run(requested.options)
        try:
            result: Result = run(requested.options)
        except SystemExit as stop:
            raise LabError(f"lab {command.name}: {command.run} raises SystemExit: {stop}; return a result") from stop
        _refuse_incomplete(command, result)
        if place is not None:
            result = result.placed(place)
            result.write(folder)
    if place is not None:
        complete(place, result.draw)
    for warning in result.warnings:
        say(f"warning: {warning}")
    with output_may_close():
        if requested.json:
            print(json.dumps(result.to_dict(), allow_nan=False))
        else:
            from lab.report.terminal import print_document
            from lab.report.view import document_of

            printing = partial(print_document, document_of(result), warnings=False)
            attempted("the summary", printing, lambda _: None, passed=(OSError,))
            if (written := requested.options.out if command.writes_on_request else place) is not None:
                print("\n".join(_where(written)))
    return result.exit_code
