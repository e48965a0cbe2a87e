"""List the commands: the core's own by an entry each, and those that extensions register as ``lab.commands``.

Nothing of a command is imported before it is run.
"""

from collections.abc import Mapping
from difflib import get_close_matches

from lab.core.errors import LabError
from lab.extension_points import load, load_all, registered
from lab.options.command import Command, OptionGroup

__all__ = ["COMMANDS", "all_commands", "command_named", "grouped_commands"]


_GROUP = "lab.commands"  # of entry points
_SENSOR = (
    *("cameras", "noise_px", "orientation", "noise_mrad", "method", "socket_distance_mm"),
    *("size_u_percent", "tip_radius_mm"),
)
_FIT = OptionGroup("model and fit", ("model", "robust", "prior", "fix"), ("fitting",))
_VERDICT = OptionGroup("verdict", ("gate_mm", "require"), ("region", "date", "serial"))
_VIRTUAL_GROUPS = (
    OptionGroup("robot and poses", ("robot", "poses", "plan", "seed"), ("cell", "targets")),
    OptionGroup(
        "errors and effects of the virtual arm, each off unless a default is named",
        ("position_sigma_mm", "rotation_sigma_mrad", "stiffness_nm_per_rad", "payload_kg", "backlash_mrad"),
        ("offset_sigma_mrad", "sampler", "dh_only", "effects"),
    ),
    OptionGroup(
        "measurement",
        ("instrument", "observe"),
        (
            "readings",
            "noise_mm",
            "occlusion",
            "orientation_share",
            "fixtures",
            "artefact_mm",
            *_SENSOR,
        ),
    ),
    _FIT,
    _VERDICT,
)
_MEASURED_GROUPS = (
    OptionGroup("robot", ("robot",), ("cell",)),
    OptionGroup("measurement", ("instrument", "noise_mm", "observe"), _SENSOR),
    _FIT,
    OptionGroup("validation", ("holdout", "holdout_last", "validate"), ("refit", "seed")),
    _VERDICT,
)
_DESIGN_GROUPS = (
    OptionGroup("robot and cell", ("robot", "cell"), ("home", "clearance_mm", "self_clearance_mm", "no_check")),
    OptionGroup(
        "poses",
        ("poses", "accuracy_mm", "extend", "check", "controller"),
        ("reference_every", "payload_kg", "candidates", "starts", "seed", "curve"),
    ),
    OptionGroup(
        "criterion",
        ("criterion", "model"),
        ("region", "scaling"),
    ),
    OptionGroup("measurement", ("instrument", "targets"), ("observe", "cameras")),
)
_COMPENSATION_GROUPS = (
    OptionGroup("targets", ("run", "program", "orientation", "controller"), ("frames", "pulses_per_deg", "digits")),
    OptionGroup("robot and cell", ("cell", "load", "no_check")),
    OptionGroup("verdict", ("require",), ("force", "accept_edited")),
)

COMMANDS = (
    Command(
        "calibrate",
        "A virtual campaign, end to end: perturb an arm, measure it, identify it, and validate it on new poses.",
        "lab.options.virtual_campaign:VirtualCampaign",
        "lab.library.calibrate:calibrate",
        "calibrate-{robot}-seed{seed}",
        examples=("--robot tx40 --poses 60 --seed 1", "--stiffness-nm-per-rad 1e5 --payload-kg 0,3 --model auto"),
        groups=_VIRTUAL_GROUPS,
        plan="plan",
        group="prepare",
    ),
    Command(
        "identify",
        "Identify an arm from measured data, and validate it on poses that were not fitted.",
        "lab.options.measured_campaign:MeasuredCampaign",
        "lab.library.identify:identify",
        "identify-{file}",
        examples=(
            "day.csv --instrument leica-at960 --holdout 0.3",
            "day.csv --robot ur10 --model auto --robust --out runs/ur10",
        ),
        groups=_MEASURED_GROUPS,
        plan="file",
    ),
    Command(
        "example",
        "List the measurements of real robots that come with the lab, or write one into the current folder.",
        "lab.options.command_options:ExampleOptions",
        "lab.library.example:example",
        examples=("ur5", "ur10-random --out data"),
        group="measure",
    ),
    Command(
        "inspect",
        "Print a robot's table, its limits, and what can be identified.",
        "lab.options.command_options:InspectOptions",
        "lab.library.inspect:inspect",
        examples=("irb120", "irb120 --model compliance+harmonics --fix link4.d"),
    ),
    Command(
        "design",
        "Choose the poses to measure, their order and number, and rate the choice.",
        "lab.options.virtual_campaign:DesignOptions",
        "lab.library.design:design",
        "design-{robot}-seed{seed}",
        examples=(
            "--robot tx40 --poses 30 --cell cell.toml",
            "--accuracy-mm 0.05 --instrument leica-at960 --out runs/plan",
        ),
        groups=_DESIGN_GROUPS,
        plan="check",
        instead=("check", "lab.library.plan_check:check_plan"),
    ),
    Command(
        "next",
        "Propose the pose to measure next, given all measured so far, and predict the accuracy; while measuring.",
        "lab.options.command_options:NextOptions",
        "lab.library.next_pose:next_pose",
        "next-{plan}",
        examples=("runs/plan", "runs/plan day.csv --follow"),
    ),
    Command(
        "import",
        "Merge a tracker's export with a controller's joint positions into a measurement file.",
        "lab.options.command_options:ImportOptions",
        "lab.library.import_measurements:import_measurements",
        "import-{points}",
        examples=(
            "tracker.txt --joints poses.csv --robot irb120",
            "tracker.txt --joints poses.csv --by order --unit mm",
        ),
    ),
    Command(
        "compensate",
        "Correct targets for a calibrated arm: joint values, corrected targets for its controller, and the arm itself.",
        "lab.options.compensation:CompensateOptions",
        "lab.library.compensate:compensate",
        "compensate-{source}",
        examples=("targets.csv --run runs/day --out runs/corrected", "--program weld.ls --run runs/day"),
        groups=_COMPENSATION_GROUPS,
    ),
    Command(
        "predict",
        "Predict where the points of a calibrated arm are at joint positions, with all effects and their uncertainty.",
        "lab.options.command_options:PredictOptions",
        "lab.library.predict:predict",
        "predict-{file}",
        examples=("runs/day joints.csv", "runs/day joints.csv --load runs/load"),
        group="use",
    ),
    Command(
        "verify",
        "Test new measurements, or daily touches of a socket, against a calibrated arm; report what moved.",
        "lab.options.command_options:VerifyOptions",
        "lab.library.verify:verification_of",
        "verify-{file}",
        examples=("runs/day check.csv --refit base --require good", "runs/day touches.csv --since 2026-05-04"),
    ),
    Command(
        "certify",
        "Write a calibration's certificate: uncertainty budget, ISO 9283, statement of conformity, traceability.",
        "lab.options.command_options:CertifyOptions",
        "lab.library.certify:certify",
        "certify-{run}",
        examples=("runs/day --details details.toml", "runs/day --tolerance-mm 0.1 --decision-rule guard-band"),
    ),
    Command(
        "history",
        "Say what moved between runs and since when; of a folder, which arms are good and when each is due.",
        "lab.options.command_options:HistoryOptions",
        "lab.arm_history.history:history",
        writes_on_request=True,
        examples=("runs/january runs/april", "runs --every-days 90 --out history"),
    ),
    Command(
        "study",
        "Run many simulated calibrations: a grid of factors, times robots, times draws of the noise.",
        "lab.options.command_options:StudyOptions",
        "lab.studies.study:study",
        examples=("grid.toml --out runs/grid", "grid.toml --out runs/grid --resume"),
        group="prepare",
    ),
)


_CALIBRATION = ("inspect", "design", "import", "identify", "next", "compensate", "certify", "verify", "history")
_HEADINGS = ("prepare", "measure", "identify", "use", "learn")


def grouped_commands() -> Mapping[str, tuple[Command, ...]]:
    """Return the commands by headings: those of a calibration in the order of its steps, then the others by groups."""
    commands = {command.name: command for command in all_commands()}
    found = {"a calibration": tuple(commands.pop(name) for name in _CALIBRATION)}
    headings = dict.fromkeys((*_HEADINGS, *(each.group for each in commands.values())))
    groups = {title: tuple(each for each in commands.values() if each.group == title) for title in headings}
    return found | {title: own for title, own in groups.items() if own}


def all_commands() -> tuple[Command, ...]:
    """Return the core's commands, then those of extensions; a core command is not replaced by one of the same name."""
    own = {command.name for command in COMMANDS}
    return (*COMMANDS, *(each for name, each in load_all(_GROUP).items() if name not in own))


def command_named(name: str) -> Command:
    """Return the command that is typed so.

    Raises:
        LabError: there is none, or its extension cannot be imported.
    """
    for command in COMMANDS:
        if command.name == name:
            return command
    if name in registered(_GROUP):
        added: Command = load(_GROUP, name)
        return added
    known = (*(command.name for command in COMMANDS), *registered(_GROUP))
    if meant := get_close_matches(name, known, 1, cutoff=0.75):
        raise LabError(f"'{name}' is no command; is {meant[0]} meant? See lab --help")
    raise LabError(f"'{name}' is no command; there are {', '.join(known)}; see lab --help")
