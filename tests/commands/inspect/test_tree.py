"""Inspection of robots with several tips: the chain to each, and what is identifiable of all."""

import json

import jsonschema
import pytest
from helpers.robots import ROOT

import lab
from lab.cli.main import main
from lab.robots.load_robot import load_robot

SCHEMA = json.loads((ROOT / "docs" / "reference" / "schemas" / "inspect.schema.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["torso", "rail"])
def test_values_have_their_schema(name: str) -> None:
    values = lab.inspect(name).to_dict()
    jsonschema.validate(json.loads(json.dumps(values)), SCHEMA)
    tree = load_robot(name).model.chain
    assert [tip["name"] for tip in values["tips"]] == list(tree.tips)
    for tip, chain in zip(values["tips"], tree.chains, strict=True):
        assert [joint["name"] for joint in tip["joints"]] == list(chain.joint_names)
        assert {joint["link"] for joint in tip["joints"]} <= {each.owner for each in lab.inspect(name).parameters}
        assert tip["mount"] is None and (tip["reach_mm"] or 0) >= 0


def test_two_arms_on_one_table_have_a_mount(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["inspect", "torso", "--base", "torso", "--tip", "left", "--tip", "right"]
    assert main([*arguments, "--json"]) == 0
    left, right = json.loads(capsys.readouterr().out)["tips"]
    assert left["mount"] is None
    x, y, z = right["mount"]["rotation_vector_deg"]
    assert (x**2 + y**2 + z**2) ** 0.5 == pytest.approx(120.0)  # 60 degrees to either side
