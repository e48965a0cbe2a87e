"""Formulas as programs: names are functions' names in every language, and an unknown language is refused."""

import pytest

from lab.formats.formula_program import FormulaProgram, function_name, programs_text


def test_programs_compute_what_their_formulas_say() -> None:
    program = FormulaProgram("f", "A test.", {"q": ("q1", "q2")}, (("a", "q1*q2"),), ("a + 0.5", "sign(q2)"))
    space: dict[str, object] = {}
    exec(programs_text((program,), "python"), space)
    assert space["f"]([3.0, -2.0]) == [-5.5, -1.0]  # type: ignore[operator]
    assert "q2 = q(2);" in programs_text((program,), "matlab")
    assert "double q2 = q[1];" in programs_text((program,), "c")
    with pytest.raises(ValueError, match="there are python, c, matlab"):
        programs_text((program,), "fortran")  # type: ignore[arg-type]


def test_names_of_functions() -> None:
    assert function_name("RX 130") == "rx_130"
    assert function_name("2-RPR") == "robot_2_rpr"
