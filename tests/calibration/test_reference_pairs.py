"""Test the lab against the reference pairs: answers of 50 correct digits, calculated without the lab."""

import copy
import json
import math
from fractions import Fraction
from typing import Any

import jsonschema
import numpy as np
import pytest
import reference_pairs
import reference_pairs_digits
from helpers.robots import ROOT

import lab

PATHS = sorted(reference_pairs_digits.FOLDER.glob("*.json"))
NAMES = [path.stem for path in PATHS]
DEFICIENT = ("rank-deficient", "still-joint")
BY_HAND = "planar-by-hand"
FAST = (BY_HAND, "planar-2r")  # to calculate again; the others take seconds to minutes


def pair_named(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((reference_pairs_digits.FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return found


def exact_inputs(name: str) -> dict[str, Any]:
    return reference_pairs.read((reference_pairs_digits.FOLDER / f"{name}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", NAMES)
def test_a_pair_agrees_with_the_schema_and_with_itself(name: str) -> None:
    pair = pair_named(name)
    schema = (ROOT / "docs" / "reference" / "schemas" / "reference_pair.schema.json").read_text(encoding="utf-8")
    jsonschema.Draft202012Validator(json.loads(schema)).validate(pair)
    results, seen = pair["results"], [p for row in pair["results"]["residuals_m"] for p in row if p is not None]
    assert pair["name"] == name and set(pair["free"]) <= set(pair["nominal"])
    assert len(pair["measurements"]["joints"]) == len(pair["measurements"]["points"]) == len(results["residuals_m"])
    assert results["degrees_of_freedom"] == 3 * len(seen) - results["rank"]
    assert ("parameters" in results) == (name not in DEFICIENT) == (results["rank"] == len(pair["free"]))
    assert list(results.get("parameters", pair["free"])) == pair["free"]


@pytest.mark.parametrize("name", NAMES)
def test_the_lab_reaches_the_reference(name: str) -> None:
    pair = pair_named(name)
    found = reference_pairs_digits.compared(pair)
    assert found.rank == (pair["results"]["rank"],) * 2
    assert found.least >= reference_pairs_digits.required(pair), found


def test_a_changed_digit_is_noticed() -> None:
    pair = pair_named("rpr")
    for change in (
        lambda r: r["parameters"].update({"link2.d": "0.2"}),
        lambda r: r["covariance"][3].__setitem__(0, "1.5e-9"),
        lambda r: r["residuals_m"][7][0].__setitem__(2, "1.234e-5"),
        lambda r: r["predicted"][1][0]["point_m"].__setitem__(0, "0.5"),
        lambda r: r["predicted"][2][0]["covariance_m2"].__setitem__(5, "1e-10"),
        lambda r: r.update(sum_of_squares="80.0"),
    ):
        wrong = copy.deepcopy(pair)
        change(wrong["results"])
        assert reference_pairs_digits.compared(wrong).least < reference_pairs_digits.required(pair)


@pytest.mark.parametrize("name", ["rpr", "near-parallel"])
def test_the_public_call_gives_the_same_parameters(name: str) -> None:
    pair = pair_named(name)
    robot = reference_pairs_digits.robot_of(pair)
    fix, free = reference_pairs_digits.wishes(pair, robot)
    data = reference_pairs_digits.measured(pair, robot)
    estimate = lab.identify(data, robot, prior="off", fix=fix, free=free, no_recording=True).estimate
    for i, (parameter, text) in enumerate(pair["results"]["parameters"].items()):
        row, std = estimate.params[parameter], math.sqrt(float(pair["results"]["covariance"][i][0]))
        assert row.value == pytest.approx(float(text), rel=1e-9, abs=1e-11)
        assert row.std == pytest.approx(std, rel=1e-6)
    ahead = np.array(pair["predict"]) * [
        1.0 if each["type"] == "prismatic" else np.pi / 180 for each in pair["robot"]["joints"]
    ]
    points = [[float(x) for x in each[0]["point_m"]] for each in pair["results"]["predicted"]]
    assert estimate.points(ahead)[:, 0] == pytest.approx(np.array(points), abs=1e-11)


def test_the_pair_by_hand_has_the_answer_in_fractions() -> None:
    """The points are a u + l v with unit vectors u, v of the sums of the joints: two normal equations."""
    pair = pair_named(BY_HAND)
    turn = {0: (1, 0), 90: (0, 1), 180: (-1, 0), -90: (0, -1)}
    uu = uv = vv = up = vp = pp = Fraction(0)
    for (q1, q2), [point] in zip(pair["measurements"]["joints"], pair["measurements"]["points"], strict=True):
        u, v, p = turn[q1], turn[q1 + q2 if q1 + q2 <= 180 else q1 + q2 - 360], [Fraction(str(x)) for x in point]
        uu, uv, vv = uu + 1, uv + u[0] * v[0] + u[1] * v[1], vv + 1
        up, vp = up + u[0] * p[0] + u[1] * p[1], vp + v[0] * p[0] + v[1] * p[1]
        pp += sum(x * x for x in p)
    det = uu * vv - uv * uv
    a, length = (vv * up - uv * vp) / det, (uu * vp - uv * up) / det
    squares = pp - a * up - length * vp
    results = pair["results"]
    exact = [a, length, squares, squares / 16 * vv / det, -squares / 16 * uv / det]
    (c00, c01), _ = results["covariance"]
    texts = [*results["parameters"].values(), results["sum_of_squares"], c00, c01]
    assert all(abs(Fraction(text) / value - 1) < Fraction(1, 10**29) for text, value in zip(texts, exact, strict=True))


def test_the_exact_pair_returns_the_truth() -> None:
    results = pair_named("exact")["results"]
    assert float(results["sum_of_squares"]) < 1e-66
    assert all(abs(float(x)) < 1e-39 for row in results["residuals_m"] for point in row for x in point)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n not in FAST)) for n in NAMES])
def test_the_calculation_gives_the_stored_results(name: str) -> None:
    assert reference_pairs.calculate(exact_inputs(name)) == pair_named(name)["results"]
