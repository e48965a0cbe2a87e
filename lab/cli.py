"""The command line: arguments in, library call, result out. Exit 0 done, 1 the answer is bad, 2 the input is bad."""

import contextlib
import io
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Union

import tyro

from lab.campaign.config_file import read_options
from lab.campaign.option_groups import Fitting, Flag, Names, Numbers
from lab.campaign.options import DesignOptions, VirtualCampaign
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.compensate.options import CompensateOptions
from lab.commands.payload.options import PayloadOptions
from lab.commands.result import Result
from lab.commands.verify.options import VerifyOptions
from lab.core.errors import LabError


@dataclass(frozen=True)
class Calibrate:
    """A virtual campaign, end to end: perturb an arm, measure it, identify it, judge it on fresh poses."""

    campaign: tyro.conf.OmitArgPrefixes[VirtualCampaign] = field(default_factory=VirtualCampaign)
    out: Path | None = None
    """The run's folder: runs/calibrate-ROBOT-seedN by default, numbered if taken; an earlier run here is replaced."""
    json: Flag = False
    """Print the result as one JSON object."""


@dataclass(frozen=True)
class Identify:
    """Identify an arm from measured data, and judge it on poses that were not fitted."""

    campaign: tyro.conf.OmitArgPrefixes[MeasuredCampaign]
    out: Path | None = None
    """The run's folder: runs/identify-FILE by default, numbered if taken; an earlier run here is replaced."""
    json: Flag = False
    """Print the result as one JSON object."""


@dataclass(frozen=True)
class Inspect:
    """Print a robot's table, its limits, and what can be identified."""

    robot: tyro.conf.Positional[str] = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    targets: Names = ("p1",)
    """Measured points of the tool."""
    tool_mm: Numbers = ()
    """Where the first of them is in the last frame; by default on the robot's tool."""
    model: str = "geometric"
    """geometric, or groups of effects joined by +."""
    fix: Names = ()
    """Hold these parameters at nominal: names or patterns."""
    free: Names = ()
    """Identify these parameters, which are usually fixed, in the place of fixed ones."""
    json: Flag = False
    """Print the same as one JSON object."""


@dataclass(frozen=True)
class Design:
    """Choose the poses to measure, their order and their number, and say how good the choice is."""

    campaign: tyro.conf.OmitArgPrefixes[DesignOptions] = field(default_factory=DesignOptions)
    out: Path | None = None
    """The plan's folder: runs/design-ROBOT-seedN by default, numbered if taken; an earlier run here is replaced."""
    json: Flag = False
    """Print the result as one JSON object."""


@dataclass(frozen=True)
class Verify:
    """Test a few new measurements against a calibrated arm; where it is no longer good, say what has moved."""

    verification: tyro.conf.OmitArgPrefixes[VerifyOptions]
    out: Path | None = None
    """The verification's folder: runs/verify-FILE by default, numbered if taken; an earlier run here is replaced."""
    json: Flag = False
    """Print the result as one JSON object."""


@dataclass(frozen=True)
class Compensate:
    """Correct targets for a calibrated arm: joint values, corrected targets for its controller, and the arm itself."""

    correction: tyro.conf.OmitArgPrefixes[CompensateOptions]
    out: Path | None = None
    """The folder for all files: runs/compensate-TARGETS by default, numbered if taken; an earlier run is replaced."""
    json: Flag = False
    """Print the result as one JSON object."""


@dataclass(frozen=True)
class Payload:
    """Identify the load at the hand: its mass, centre of mass and inertia, each with its interval."""

    task: tyro.conf.OmitArgPrefixes[PayloadOptions]
    out: Path | None = None
    """The folder for all files: runs/payload-FILE by default, numbered if taken; an earlier run here is replaced."""
    json: Flag = False
    """Print the result as one JSON object."""


@dataclass(frozen=True)
class Study:
    """Run many virtual campaigns: a grid of factors, times robots, times draws of the noise."""

    config: tyro.conf.Positional[Path]
    """The study, TOML."""
    out: Path | None = None
    """The study's folder: runs/study-NAME by default, numbered if taken."""
    resume: Flag = False
    """Go on with the study in --out that was killed or stopped."""
    workers: int | None = None
    """How many processes of this machine: one for each core by default."""
    scheduler: str | None = None
    """Address of a dask.distributed scheduler whose workers do it instead, e.g. tls://host:8786."""
    json: Flag = False
    """Print the result as one JSON object."""


Command = Calibrate | Identify | Inspect | Design | Compensate | Verify | Payload | Study
_COMMANDS: dict[str, type[Command]] = {
    "calibrate": Calibrate,
    "identify": Identify,
    "inspect": Inspect,
    "design": Design,
    "compensate": Compensate,
    "verify": Verify,
    "payload": Payload,
    "study": Study,
}
_CONFIGURED = {"calibrate": VirtualCampaign, "identify": MeasuredCampaign, "design": DesignOptions}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit code."""
    try:
        command = _parsed(sys.argv[1:] if arguments is None else list(arguments))
        if isinstance(command, Inspect):
            code = _inspect(command)
        elif isinstance(command, Verify):
            code = _verify(command)
        elif isinstance(command, Compensate):
            code = _compensate(command)
        elif isinstance(command, Payload):
            code = _payload(command)
        elif isinstance(command, Study):
            code = _study(command)
        else:
            code = _design(command) if isinstance(command, Design) else _campaign(command)
        sys.stdout.flush()
        return code
    except LabError as error:
        print(f"lab: {error}", file=sys.stderr)
        return 2
    except OSError as error:  # of files the library tells; what is left is the output
        sys.stdout = io.StringIO()  # so that Python does not try once more when it ends
        print(f"lab: the output cannot be written ({error.strerror}); look where it goes", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("lab: interrupted; nothing was written", file=sys.stderr)
        return 130


def _parsed(arguments: list[str]) -> Command:
    """The command; what cannot be parsed ends the program with one line and exit code 2.

    Raises:
        LabError: ``--config`` names what is no run's config.json.
    """
    arguments, configured = _configured(arguments)
    kinds = tuple(
        Annotated[kind, tyro.conf.subcommand(name, **({"default": configured[name]} if name in configured else {}))]
        for name, kind in _COMMANDS.items()
    )
    commands: Any = Union[kinds]  # noqa: UP007
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            command: Command = tyro.cli(
                commands,
                prog="lab",
                description="Plan, run and judge the calibration of a robot arm, virtual or measured. "
                "With --config FILE the options of an earlier run (its config.json) are the usual ones.",
                args=arguments,
                config=(tyro.conf.OmitSubcommandPrefixes,),
            )
    except SystemExit as stop:
        if stop.code not in (0, None):
            print(f"lab: {_one_line(said.getvalue())}", file=sys.stderr)
        raise
    return command


def _configured(arguments: list[str]) -> tuple[list[str], dict[str, Any]]:
    """The arguments without ``--config FILE``, and by its name the command with that file's options."""
    arguments = [part for given in arguments for part in _apart(given)]
    if not arguments or arguments[0] not in _CONFIGURED or "--config" not in arguments:
        return arguments, {}
    at = arguments.index("--config")
    if at + 1 == len(arguments):
        raise LabError("--config: give the config.json of an earlier run")
    name = arguments[0]
    options: Any = read_options(Path(arguments[at + 1]), name, _CONFIGURED[name])
    made: Any = _COMMANDS[name]
    return [*arguments[:at], *arguments[at + 2 :]], {name: made(campaign=options)}


def _apart(argument: str) -> tuple[str, ...]:
    """``--config=FILE`` as two arguments; any other as it is."""
    name, _, value = argument.partition("=")
    return (name, value) if name == "--config" and value else (argument,)


def _one_line(panel: str) -> str:
    """What a boxed message says, without the box and all but its first paragraph."""
    lines = [re.sub(r"[│╭╮╰╯]", "", line).strip() for line in panel.splitlines()]
    body = lines[1:] if panel.lstrip().startswith("╭") else lines
    paragraph = []
    for line in body:
        if line and not line.strip("─"):
            break
        paragraph.append(line)
    text = " ".join(" ".join(paragraph).split()).removesuffix(".")
    text = re.sub(r"invalid literal for int\(\) with base 10: (.*)", r"\1 is not a whole number", text)
    text = re.sub(r"could not convert string to float: (.*)", r"\1 is not a number", text)
    return f"{text}; see lab --help"


def _campaign(command: Calibrate | Identify) -> int:
    """Run, write and print a campaign; 1 where its verdict is bad."""
    from lab.calibration.observations.protocol import observation_of
    from lab.commands.calibrate.console import print_outcome
    from lab.commands.calibrate.result import summary
    from lab.commands.calibrate.run import run_measured, run_virtual
    from lab.commands.run_folder import write_run

    options = command.campaign
    inputs: tuple[Path | None, ...]
    if isinstance(options, MeasuredCampaign):
        stem, inputs = f"identify-{options.file.stem}", (options.file, options.validate)
    else:
        stem, inputs = f"calibrate-{Path(options.robot).stem}-seed{options.seed}", (options.plan,)
    with _written(command.out, stem, *inputs) as (folder, out):
        outcome = run_measured(options) if isinstance(options, MeasuredCampaign) else run_virtual(options)
        write_run(folder, outcome, options)
        if observation_of(outcome.identification.model).positions:  # of a cable or a socket there is nothing to draw
            from lab.commands.calibrate.recording import record  # slow to import: only once there is something to show

            record(folder / "recording.rrd", outcome)
        from lab.commands.calibrate.report import write_report  # slow to import, as all that draws

        write_report(folder / "report.html", outcome, options)
    _tell(outcome.warnings, summary(outcome) if command.json else None)
    if not command.json:
        print_outcome(outcome, out)
    return 1 if outcome.verdict.word == "bad" else 0


def _design(command: Design) -> int:
    """Choose, write and print a plan."""
    from lab.commands.design.console import print_plan
    from lab.commands.design.result import plan_summary, write_plan
    from lab.commands.design.run import plan_campaign

    options = command.campaign
    stem = f"design-{Path(options.robot).stem}-seed{options.seed}"
    with _written(command.out, stem, options.extend) as (folder, out):
        with _status() as progress:
            plan = plan_campaign(options, progress)
        write_plan(folder, plan)
        from lab.commands.design.figures import plot_plan
        from lab.commands.design.recording import record_plan  # slow to import, as the plots are
        from lab.commands.design.report import write_plan_report

        plot_plan(folder, plan)
        write_plan_report(folder, plan)
        record_plan(folder / "recording.rrd", plan)
    _tell(plan.warnings, plan_summary(plan) if command.json else None)
    if not command.json:
        print_plan(plan, out)
    return 0


def _compensate(command: Compensate) -> int:
    """Correct, write and print; 1 where a target is not reached."""
    from lab.commands.compensate.run import run_correction

    asked = command.correction
    with _written(command.out, f"compensate-{asked.targets.stem}", asked.targets, asked.run) as (folder, out):
        result = run_correction(asked)
        result.write(folder)
    return _finished(result, out, command.json)


def _verify(command: Verify) -> int:
    """Test, write and print; 1 where something has changed."""
    from lab.commands.verify.run import run_verification

    asked = command.verification
    with _written(command.out, f"verify-{asked.file.stem}", asked.file, asked.run) as (folder, out):
        result = run_verification(asked)
        result.write(folder)
    return _finished(result, out, command.json)


def _finished(result: Result, folder: Path, as_json: bool) -> int:
    """Print a result, for a person or as JSON, and say where its files are; its exit code."""
    from lab.render.terminal import print_document

    _tell(result.warnings, result.to_dict() if as_json else None)
    if not as_json:
        print_document(result.document(), warnings=False)
        print(f"run: {folder}")
    return result.exit_code


def _payload(command: Payload) -> int:
    """Identify, write and print; 1 where the load's weight is not told, or the residuals say not to believe it."""
    from lab.commands.payload.run import run_payload

    asked = command.task
    with _written(command.out, f"payload-{asked.file.stem}", asked.file, asked.sensor, asked.run) as (folder, out):
        result = run_payload(asked)
        result.write(folder)
    return _finished(result, out, command.json)


def _study(command: Study) -> int:
    """Run a study, or go on with one; 130 where it was interrupted."""
    from lab.commands.run_folder import free_name
    from lab.studies.executors import StoppedError, cluster_executor, local_executor
    from lab.studies.grid import read_study
    from lab.studies.progress import bars
    from lab.studies.run import run_study

    if command.resume and command.out is None:
        raise LabError("--resume goes on with a study: give its folder, --out")
    if command.scheduler is not None and command.workers is not None:
        raise LabError("--workers is of processes of this machine, --scheduler of a cluster; give one")
    study = read_study(command.config)
    place = command.out or free_name(Path("runs"), f"study-{study.name}")
    chosen = local_executor(command.workers) if command.scheduler is None else cluster_executor(command.scheduler)
    try:
        with bars() as progress, chosen as executor:
            done = run_study(study, place, executor, resume=command.resume, progress=progress)
    except StoppedError as error:
        raise LabError(f"{place}: {error}") from error
    except KeyboardInterrupt:
        print(f"lab: interrupted; --resume goes on with what is in {place}", file=sys.stderr)
        return 130
    from lab.commands.study.report import print_study, write_study  # slow to import, as all that draws

    analysis = write_study(done)
    _tell((), done.summary if command.json else None)
    if not command.json:
        print_study(done, analysis)
    return 0


@contextlib.contextmanager
def _written(out: Path | None, stem: str, *inputs: Path | None) -> Iterator[tuple[Path, Path]]:
    """The folder to write a run into, and what it becomes when the block ends well; ``inputs`` are not replaced."""
    from threadpoolctl import threadpool_limits

    from lab.commands.run_folder import free_name, run_folder

    place = out or free_name(Path("runs"), stem)
    with (
        threadpool_limits(1),
        run_folder(place, [path for path in inputs if path]) as folder,
    ):  # small matrices: more threads wait for each other
        yield folder, place


@contextlib.contextmanager
def _status() -> Iterator[Callable[[str], None]]:
    """What long work is at, on a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda stage: None
        return
    from rich.console import Console

    with Console(stderr=True).status("planning") as status:
        yield lambda stage: status.update(f"planning: {stage}")


def _tell(warnings: Sequence[str], result: dict[str, Any] | None) -> None:
    """Warnings for a person, and the result for a program if one is asked for."""
    for warning in warnings:
        print(f"lab: warning: {warning}", file=sys.stderr)
    if result is not None:
        print(json.dumps(result, allow_nan=False))


def _inspect(command: Inspect) -> int:
    """Print what a robot is and what of it can be identified."""
    from lab.campaign.robot import load_robot
    from lab.commands.inspect.run import Question, inspection, print_inspection

    robot = load_robot(command.robot)
    fitting = Fitting(command.model, fix=command.fix, free=command.free)
    fitting.check()
    if command.model == "auto":
        raise LabError("--model auto: groups are chosen by measurements; name groups to inspect")
    question = Question(robot, command.targets, fitting.groups, command.fix, command.free, command.tool_mm)
    _tell(robot.warnings, inspection(question) if command.json else None)
    if not command.json:
        print_inspection(question)
    return 0
