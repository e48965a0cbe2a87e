"""How well an arm's dynamic parameters are identified: the tables of the study, and its advice."""

from lab.experiments.arm_dynamics import BIASES, Options, Row, coverage, loads, noise_free, power, study_of
from lab.experiments.script import Answer
from lab.render.document import Document, Paragraph, Section, Table
from lab.render.format import short

__all__ = ["advice", "answer"]

_ALIKE = 1.1  # times the other's error: what is closer is alike


def answer(options: Options) -> Answer:
    """All parts, one after another."""
    study = study_of(options)
    exact = noise_free(study)
    parameters, whole = coverage(study)
    biases, ways = power(study, BIASES), loads(study)
    values = {"noise_free": exact, "parameters": parameters, "coverage": whole, "power": biases, "loads": ways}
    return Answer(values | {"advice": advice(ways)}, _document(exact, parameters, whole, biases, ways))


def advice(ways: list[Row]) -> str:
    """Which way to identify a load, in a sentence."""
    best = []
    for servo in sorted({float(row["servo_rad_per_nm"]) for row in ways}):
        once, apart = (float(row["mass_percent"]) for row in ways if row["servo_rad_per_nm"] == servo)
        best.append("alike" if max(once, apart) < _ALIKE * min(once, apart) else "once" if once < apart else "apart")
    same, shifted = best
    first = {
        "alike": "both ways are as good",
        "once": "the fit with the arm is better",
        "apart": "the difference is better",
    }
    return (
        f"Where both runs are along one path {first[same]}, and where the load shifts the path {first[shifted]}: "
        + ("take the difference if only the load is asked for, else fit both at once." if shifted != "once" else
           "fit load and arm at once, unless the paths are known to be the same.")
    )  # fmt: skip


def _document(exact: Row, parameters: list[Row], whole: Row, biases: list[Row], ways: list[Row]) -> Document:
    return Document(
        "How well are an arm's dynamic parameters identified?",
        (
            Paragraph(
                f"Without noise the base parameters are off by {short(float(exact['base_parameters']))} at most, the "
                f"load by {short(float(exact['load']))} (SI)."
            ),
            Section("Intervals and predictions", (_table(whole),)),
            Section("Parameters", (_parameters(parameters),)),
            Section("What is told", (_biases(biases),)),
            Section("The load", (_ways(ways), Paragraph(advice(ways)))),
        ),
    )


def _table(row: Row) -> Table:
    return Table(("", ""), tuple((key.replace("_", " "), short(float(value))) for key, value in row.items()))


def _parameters(rows: list[Row]) -> Table:
    cells = tuple(
        (str(row["parameter"]), short(_true(row)), short(float(row["sigma"])), _relative(row), str(row["unit"]))
        for row in rows
    )
    return Table(("base parameter", "true", "σ", "relative σ", "unit"), cells)


def _true(row: Row) -> float:
    return float(row["true"]) if row["relative_sigma"] != float("inf") else 0.0


def _relative(row: Row) -> str:
    return "–" if row["relative_sigma"] == float("inf") else short(100 * float(row["relative_sigma"]), "%")


def _biases(rows: list[Row]) -> Table:
    numbers = [(float(row["size"]), float(row["bias_sigma"]), 100 * float(row["told"])) for row in rows]
    cells = tuple(
        (str(row["wrong"]), short(size), short(worst), short(told, "%"))
        for row, (size, worst, told) in zip(rows, numbers, strict=True)
    )
    return Table(("wrong", "size", "worst bias, σ", "told"), cells)


def _ways(rows: list[Row]) -> Table:
    names = ("servo_rad_per_nm", "mass_percent", "centre_mm", "inertia_kgcm2", "mass_bias_percent", "centre_bias_mm")
    cells = tuple((str(row["way"]), *(short(float(row[name])) for name in names)) for row in rows)
    heads = ("shift, rad/Nm", "mass, %", "centre, mm", "inertia, kg cm²", "mass, mean", "centre, mean")
    return Table(("RMS errors", *heads), cells)
