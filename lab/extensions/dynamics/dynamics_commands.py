"""Register the commands ``lab payload`` and ``lab dynamics``."""

from lab.options.command import Command, OptionGroup

__all__ = ["DYNAMICS", "PAYLOAD"]

_SIMULATION = OptionGroup("simulated session", ("simulate", "seed"), ("rehearsal",))
_PAYLOAD_GROUPS = (
    OptionGroup("robot and payload", ("robot", "sensor", "method"), ("cell", "run", "serial", "accept_edited")),
    OptionGroup("estimate", ("friction", "physical"), ("delay", "tilt", "turn", "stiffness_nm_per_rad")),
    _SIMULATION,
)
_DYNAMICS_GROUPS = (
    OptionGroup("robot", ("robot", "drives", "load"), ("sensor", "serial")),
    OptionGroup("estimate", ("without", "physical", "symbolic"), ("delay", "band_hz")),
    OptionGroup("validation", ("holdout", "validate")),
    _SIMULATION,
)

PAYLOAD = Command(
    "payload",
    "Identify the payload at the flange: its mass, centre of mass and inertia, each with its interval.",
    "lab.extensions.dynamics.dynamics_options:PayloadOptions",
    "lab.extensions.dynamics.payload.identify_payload:payload",
    "payload-{file}",
    examples=("load.csv --robot tx40 --sensor sensor.toml", "--simulate --robot tx40 --payload-kg 1.5"),
    groups=_PAYLOAD_GROUPS,
    group="identify",
)

DYNAMICS = Command(
    "dynamics",
    "Identify an arm's own dynamics: base parameters of links, motors and friction, with a load or without.",
    "lab.extensions.dynamics.dynamics_options:DynamicsOptions",
    "lab.extensions.dynamics.arm.arm_dynamics:dynamics",
    "dynamics-{robot}",
    examples=("motion.csv --robot tx40 --holdout 0.3", "--simulate --robot scara --rounds 0"),
    groups=_DYNAMICS_GROUPS,
    group="identify",
)
