"""Register the commands ``lab payload`` and ``lab dynamics``."""

from lab.commands.registry import Command

__all__ = ["DYNAMICS", "PAYLOAD"]

PAYLOAD = Command(
    "payload",
    "Identify the payload at the flange: its mass, centre of mass and inertia, each with its interval.",
    "lab.extensions.dynamics.options:PayloadOptions",
    "lab.extensions.dynamics.payload.run:payload",
    "payload-{file}",
)

DYNAMICS = Command(
    "dynamics",
    "Identify an arm's own dynamics: base parameters of links, motors and friction, with a load or without.",
    "lab.extensions.dynamics.options:DynamicsOptions",
    "lab.extensions.dynamics.arm.run:dynamics",
    "dynamics-{robot}",
)
