"""Arms, derivative checks and data that several tests share."""

from pathlib import Path

import numpy as np
import pytest

from lab.core.se3 import Array
from lab.kinematics.serial.chain import Chain, parallel_links
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot

ROOT = Path(__file__).parent.parent.parent
MODELS = ROOT / "models"
UNLICENSED = ROOT.parent / "shared" / "data"  # measured data without a licence: never copied, read where they lie
IRB120 = load_robot("irb120")


def data_file(name: str) -> Path:
    """Return a file of measured data: one that ships with a model, or one beside the checkout.

    A test that asks for a file without a licence is skipped where that file is absent.
    """
    shipped = next(MODELS.glob(f"*/measured/{name}"), None)
    if shipped is None and not (UNLICENSED / name).is_file():
        pytest.skip(f"{name} has no licence to ship, and is not beside the checkout")
    return shipped or UNLICENSED / name


def chain_of(
    name: str, convention: str, kinds: str, alpha_deg: list, a: list, theta_deg: list, d: list, lower=None, upper=None
) -> Chain:
    """A chain from a table as the literature prints it (degrees, metres); ``kinds`` like "RPPRRR"."""
    n = len(kinds)
    prismatic = tuple(kind == "P" for kind in kinds)
    alpha, theta = np.deg2rad(np.array(alpha_deg, float)), np.deg2rad(np.array(theta_deg, float))
    table = np.column_stack([theta, np.array(d, float), np.array(a, float), alpha, np.zeros(n)])
    high = np.where(prismatic, 1.0, 2.6) if upper is None else np.array(upper, float)
    low = np.where(prismatic, 0.2, -2.6) if lower is None else np.array(lower, float)
    names = tuple(f"q{i + 1}" for i in range(n))
    return Chain(
        name=name,
        convention=convention,
        joint_names=names,
        prismatic=prismatic,
        table=table,
        sign=np.ones(n),
        lower=low,
        upper=high,
        speed=np.full(n, np.nan),
        acceleration=np.full(n, np.nan),
        parallel=parallel_links(convention, alpha),
    )


# Craig tables of the literature: alpha, a, theta, d
RX130 = chain_of("rx130", "craig", "RRRRRR", [0, -90, 0, 90, -90, 90], [0, 0, 0.625, 0, 0, 0], [0, -90, 90, 0, 0, 0],
                 [0, 0, 0, 0.625, 0, 0.11])  # fmt: skip
TX40 = chain_of("tx40", "craig", "RRRRRR", [0, -90, 0, 90, -90, 90], [0, 0, 0.225, 0, 0, 0], [0, -90, 90, 0, 0, 0],
                [0, 0, 0.035, 0.225, 0, 0.065])  # fmt: skip
SCEMI = chain_of(
    "scemi", "craig", "RRRRRR", [0, 90, 0, -90, 90, -90], [0, 0, 0.5, 0, 0, 0], [0] * 6, [0, 0, 0, 0.5, 0, 0.1]
)
VERSATRAN = chain_of("versatran", "craig", "RPPRRR", [0, 0, -90, 0, -90, 90], [0] * 6, [0] * 6, [0] * 6)
SCARA = chain_of("scara", "craig", "RRPR", [0, 0, 0, 0], [0, 0.4, 0.25, 0], [0] * 4, [0] * 4)


# the IRB 120's ways to one pose, degrees: thesis III.2.2
EIGHT = np.array(
    [
        [100, 27.12, -64.90, -38.99, 30.72, 120.98],
        [100, 27.12, -64.90, 141.01, -30.72, -59.02],
        [100, 40.00, -89.00, -30.00, 40.00, 110.00],
        [100, 40.00, -89.00, 150.00, -40.00, -70.00],
        [-80, -40.00, -64.90, 158.99, 63.70, 95.80],
        [-80, -40.00, -64.90, -21.01, -63.70, -84.20],
        [-80, -27.12, -89.00, 156.37, 53.32, 100.78],
        [-80, -27.12, -89.00, -23.63, -53.32, -79.22],
    ]
)


def somewhere(arm: SerialArm, rng: np.random.Generator) -> Array:
    """Nominal links with the base anywhere."""
    values = arm.nominal()
    values[:3], values[3:6] = rng.normal(size=3), rng.normal(size=3)
    return values


def perturbed(arm: SerialArm, values: Array, rng: np.random.Generator, metres: float, radians: float) -> Array:
    """Every parameter off by normal draws."""
    angular = np.array([name.rsplit(".", 1)[1] in ("rx", "ry", "rz", "theta", "alpha", "beta") for name in arm.names])
    return values + np.where(angular, radians, metres) * rng.normal(size=len(values))


def assert_derivatives(function, derivative: Array, at: Array, relative: float = 1e-9) -> None:
    """The one harness for every Jacobian: complex steps, exact to rounding, column by column."""
    for column in range(len(at)):
        step = np.zeros(len(at), dtype=complex)
        step[column] = 1e-30j
        expected = function(at + step).imag / 1e-30
        scale = max(np.abs(expected).max(), 1e-3)
        np.testing.assert_allclose(
            derivative[..., column], expected, rtol=0, atol=relative * scale, err_msg=f"column {column}"
        )
