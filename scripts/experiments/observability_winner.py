"""Tables IV.2 and IV.3 of the thesis live: any index, noise and seed, and how probably each index has the least RMS.

Mahdadi and Bouafia (2020) choose 20 poses by each index, simulate one campaign with each, and call O3 the best. Here
each search of poses is repeated with other seeds, and each campaign with many draws of the noise: with all 19 rows of
table IV.2, and without the three whose errors are those of dropped parameters.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from live_tables import Chance, LiveTables, chances, commonest_order, live_tables
from shared import Answer, Document, Flag, Row, Section, Table, paragraphs, run_script

from lab.core.errors import LabError
from lab.extensions.reproduction.thesis_case import CRITERIA, INTO, OFFSETS, thesis_case

ROWS = {True: "all 19 rows", False: "without d3, θ5, α5"}


@dataclass(frozen=True)
class Options:
    """Which tables."""

    indices: tuple[str, ...] = CRITERIA
    """Indices that choose poses: O1 to O5, condition, A, random."""
    noise_um: float = 8.0
    """Half the width of the uniform noise of each coordinate, µm."""
    seed: int = 0
    """Seed of the tables: of the candidates, the search and the noise; further searches have the seeds after it."""
    searches: int = 10
    """Searches over which probabilities and the order are taken."""
    draws: int = 2000
    """Draws of the noise with the poses of each search."""
    json: Flag = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """Compute the tables of the seed, and the probabilities over the searches."""
    if options.searches < 1:
        raise LabError(f"--searches {options.searches}: give 1 or more")
    found = [
        live_tables(options.indices, options.noise_um, options.seed + i, options.draws) for i in range(options.searches)
    ]
    won = {all_rows: chances(found, all_rows=all_rows) for all_rows in ROWS}
    order, times = commonest_order(found)
    blocks = (
        _estimates(found[0]),
        _performance(found[0]),
        _scores(found[0]),
        _winners(won),
        *paragraphs(_words(found, won)),
    )
    values = {
        "seed": options.seed, "noise_um": options.noise_um, "searches": options.searches, "draws": options.draws,
        "estimates": {name: each.tolist() for name, each in found[0].estimates().items()},
        "rows": {"all": _row_values(found[0], all_rows=True), "without": _row_values(found[0], all_rows=False)},
        "scores": found[0].scores,
        "least_rms": {
            "all": {name: asdict(each) for name, each in won[True].items()},
            "without": {name: asdict(each) for name, each in won[False].items()},
        },
        "order_without": list(order), "searches_with_it": times, "expected_without": _expected(found),
    }  # fmt: skip
    title = f"Tables IV.2 and IV.3, noise of ±{options.noise_um:g} µm, seed {options.seed}"
    return Answer(values, Document(title, (Section("Tables", blocks),)))


def _row_values(found: LiveTables, *, all_rows: bool) -> dict[str, Any]:
    """One draw, and the quantiles 2.5, 50 and 97.5 % over the draws, of each row and index."""
    return {
        row: {
            name: {"one_draw": float(each[0]), "quantiles": np.quantile(each, (0.025, 0.5, 0.975)).tolist()}
            for name, each in by_index.items()
        }
        for row, by_index in found.rows(all_rows=all_rows).items()
    }


def _estimates(found: LiveTables) -> Table:
    rows: list[Row] = []
    estimates = found.estimates()
    for i, (name, true) in enumerate(OFFSETS.items()):
        form, unit = (".5f", "rad") if thesis_case().parameter(name).is_angle else (".4f", "mm")
        marked = " *" if name in INTO.values() else ""
        cells = [f"{each[i]:{form}}" for each in estimates.values()]
        rows.append((f"{name}{marked}", unit, f"{true:{form}}", *cells))
    caption = "Table IV.2: true and estimated values of one draw; * rows that hold dropped parameters"
    return Table(("parameter", "", "true", *estimates), tuple(rows), caption)


def _performance(found: LiveTables) -> Table:
    rows: list[Row] = []
    for all_rows, words in ROWS.items():
        for row, by_index in _row_values(found, all_rows=all_rows).items():
            one = [f"{each['one_draw']:.5f}" for each in by_index.values()]
            rows.append((row, words, "one draw", *one))
            ranges = ["{:.5f} to {:.5f}".format(*np.array(each["quantiles"])[[0, 2]]) for each in by_index.values()]
            rows.append(("", "", "95 % of draws", *ranges))
    return Table(("", "", "", *found.errors), tuple(rows), "Table IV.3: mm and rad as they are")


def _scores(found: LiveTables) -> Table:
    rows: list[Row] = [
        (f"poses by {name}", *(f"{100 * value:.1f} %" for value in scores.values()))
        for name, scores in found.scores.items()
    ]
    caption = "Each index of each set of poses, over the best of these sets"
    return Table(("", *next(iter(found.scores.values()))), tuple(rows), caption)


def _winners(won: dict[bool, dict[str, Chance]]) -> Table:
    rows: list[Row] = []
    for all_rows, words in ROWS.items():
        cells = [f"{100 * e.mean:.0f} % ({100 * e.lower:.0f} to {100 * e.upper:.0f})" for e in won[all_rows].values()]
        rows.append((words, *cells))
    return Table(("least RMS", *won[True]), tuple(rows), "Probability of the least RMS, and its 95 % interval")


def _words(found: list[LiveTables], won: dict[bool, dict[str, Chance]]) -> list[str]:
    order, times = commonest_order(found)
    lines = []
    for all_rows, words in ROWS.items():
        best = max(won[all_rows], key=lambda name: won[all_rows][name].mean)
        lines.append(
            f"{words}: {best} has the least RMS most often, in {100 * won[all_rows][best].mean:.0f} % of draws."
        )
    expected = _expected(found)
    listed = ", ".join(f"{name} ({expected[name]:.5f})" for name in order)
    return [*lines, f"Expected RMS without the three rows: {listed}; this order in {times} of {len(found)} searches."]


def _expected(found: list[LiveTables]) -> dict[str, float]:
    """Return the median over the searches of the expected RMS without the three rows, by index."""
    return {name: float(np.median([each.expected[name] for each in found])) for name in found[0].expected}


if __name__ == "__main__":
    run_script("observability_winner")
