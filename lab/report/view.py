"""Show results: views registered by the type of a result, and what is made by them.

A result holds data alone and does not know its view. The views of the core are the table ``_VIEWS``; a package
registers those of its own results as entry points ``lab.views``, under the name of the class. A result without a view
is shown as its table.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from html import escape
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

from lab.core.errors import LabError
from lab.core.extras import optional
from lab.core.gaps import attempted
from lab.core.number_text import short
from lab.core.whole_folder import draft_file
from lab.extension_points import load, load_reference, registered
from lab.library.result import Result
from lab.report.document import Block, Card, Document, Picture, Section, Table, Warnings, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "View", "document_of", "draw", "figure_of", "html_cell", "is_recorded", "recording_viewer", "text_of", "view_of",
    "viewer_of", "write_page",
]  # fmt: skip

_GROUP: Final = "lab.views"  # of entry points
_FIRST_ROWS: Final = 20  # of the table of a result without a view
_CELL_WARNINGS: Final = 3  # of a notebook's cell
_CELL_TEXT: Final = 400  # characters of a line there


def _always(result: Any) -> bool:
    return True


def _measures_points(result: Any) -> bool:
    """Return False of a cable or a socket, where there is nothing to draw."""
    from lab.calibration.observation import observation_of

    return bool(observation_of(result.identification.model).positions)


@dataclass(frozen=True)
class View:
    """The functions that show the results of one type, each ``module:function``; they are imported on use.

    Attributes:
        document: from the result to the ``Document`` that terminal, page and recording show.
        picture: from the result to the ``Picture`` of its main figure, with a LabError where there is nothing to draw;
            empty where there never is.
        record: writes the recording, of a path and the result; empty where there is none.
        recorded_if: whether there is anything to record in a result.
        figures: writes pictures beside the page, of the result and its folder; empty where there are none.
        provenance: from the result to the ``Section`` on what was done.
    """

    document: str = "lab.report.view:_table_document"
    picture: str = ""
    record: str = ""
    recorded_if: Callable[[Any], bool] = _always
    figures: str = ""
    provenance: str = "lab.report.views.provenance:provenance_section"


def _in(reference: str) -> str:
    return f"lab.report.views.{reference}"


_VIEWS: Final[Mapping[str, View]] = {
    "CalibrationResult": View(
        _in("calibration_document:document_of"),
        _in("calibration_figures:main_picture"),
        _in("calibration_recording:record"),
        _measures_points,
    ),
    "Certificate": View(_in("certificate_document:certificate_document"), _in("certificate_document:main_picture")),
    "CompensationResult": View(
        _in("compensation_document:compensation_document"),
        _in("compensation_document:corrections_picture"),
        _in("error_recording:record_compensation"),
        lambda result: len(result.reached) > 0,
    ),
    "DesignResult": View(
        _in("design_document:design_document"),
        _in("design_document:main_picture"),
        _in("design_recording:record_plan"),
    ),
    "ExampleResult": View(_in("example_document:example_document")),
    "HistoryResult": View(_in("history_document:history_document"), _in("history_document:main_picture")),
    "ImportResult": View(_in("import_document:import_document")),
    "Inspection": View(_in("inspection_document:inspection_document"), _in("inspection_document:main_picture")),
    "NextPoseResult": View(_in("next_document:next_document"), record=_in("next_recording:record_proposals")),
    "PlanCheckResult": View(_in("design_document:check_document")),
    "PredictionResult": View(_in("prediction_document:prediction_document"), _in("prediction_document:radii_picture")),
    "StudyResult": View(
        _in("study_document:study_document"),
        _in("study_figures:first_picture"),
        figures=_in("study_figures:write_pictures"),
        provenance=_in("study_document:provenance_of"),
    ),
    "TouchPlan": View(_in("touch_plan_document:plan_document")),
    "TouchesResult": View(_in("touches_document:touches_document")),
    "VerificationResult": View(
        _in("verification_document:verification_document"),
        _in("verification_document:errors_picture"),
        _in("error_recording:record_verification"),
    ),
}


@cache
def view_of(kind: type[Result]) -> View:
    """Return the view of a type of results: its own, or that of its nearest base; a plain table without any."""
    return attempted(f"the view of {kind.__name__}", lambda: _registered_view(kind), lambda _: View())


def _registered_view(kind: type[Result]) -> View:
    for each in kind.__mro__:
        if each.__module__.startswith("lab.") and each.__name__ in _VIEWS:
            return _VIEWS[each.__name__]
        if each.__name__ in registered(_GROUP):
            view = load(_GROUP, each.__name__)
            if not isinstance(view, View):
                raise LabError(f"the entry point '{each.__name__}' of {_GROUP} is no lab.report.view.View; repair it")
            return view
    return View()


def document_of(result: Result) -> Document:
    """Build the one document that terminal, page and recording show; a part that fails is left out, with a warning."""
    view = view_of(type(result))

    def bare(missing: str) -> Document:
        return Document(f"lab {result.command}", (Warnings((missing, *result.warnings)),))

    def provenance() -> Block:
        section = load_reference(view.provenance)(result)
        if not isinstance(section, Section):
            raise TypeError(f"it is a {type(section).__name__}, not a Section")
        return section

    made: Document = attempted("the text", lambda: load_reference(view.document)(result), bare)
    done = attempted("the section on what was done", provenance, lambda missing: Warnings((missing,)))
    return replace(made, blocks=(*made.blocks, done))


def _table_document(result: Result) -> Document:
    """Build the document of a result without a view: its warnings and its table."""
    columns = result.columns()
    rows = zip(*columns.values(), strict=True)
    cells = tuple(tuple(map(_cell, row)) for row in islice(rows, _FIRST_ROWS))
    count = max(map(len, columns.values()), default=0)
    table = Table(tuple(columns), cells, most_rows=_FIRST_ROWS, count=count)
    return Document(f"lab {result.command}", (Warnings(tuple(result.warnings)), table))


def _cell(value: Any) -> str:
    is_number = isinstance(value, float) or hasattr(value, "dtype")
    return short(float(value)) if is_number and not isinstance(value, str) else str("–" if value is None else value)


def text_of(result: Result) -> str:
    """Return the printed output of the command, as plain text."""
    from lab.report.terminal import to_text

    return "\n".join(line.rstrip() for line in to_text(document_of(result)).splitlines()).strip()


def html_cell(result: Result) -> str:
    """Return a small table for a notebook's cell: title, verdict, main numbers, warnings, and how to get the page."""
    document = document_of(result)
    rows = [(result.command, document.title), *islice(_card_rows(document.blocks), 8)]
    rows += [("warning", text) for text in result.warnings[:_CELL_WARNINGS]]
    if (more := len(result.warnings) - _CELL_WARNINGS) > 0:
        rows.append(("warnings", f"and {more:,} more"))
    table = "".join(f"<tr><th>{escape(name)}</th><td>{escape(_cut(text))}</td></tr>" for name, text in rows)
    return (
        f"<table>{table}</table><p><code>report(path)</code> writes the page, <code>summary()</code> is its text.</p>"
    )


def _card_rows(blocks: Iterable[Block]) -> Iterator[tuple[str, str]]:
    """Yield name and text of the verdict and the large numbers of a document."""
    for card in blocks:
        if isinstance(card, Card):
            yield "", plain(card.verdict)
            yield from ((caption, number) for caption, number, _ in card.numbers)


def _cut(text: str) -> str:
    return text if len(text) <= _CELL_TEXT else f"{text[:_CELL_TEXT]} …"


def figure_of(result: Result) -> "Figure":
    """Draw the result's main figure by matplotlib.

    Raises:
        LabError: there is nothing to draw, or matplotlib is not installed (the extra ``plots``).
    """
    view = view_of(type(result))
    if not view.picture:
        raise LabError(f"the result of lab {result.command} has no figure; report(path) writes its page")
    optional("matplotlib", "plot()")
    picture: Picture = load_reference(view.picture)(result)
    return picture.draw()


def is_recorded(result: Result) -> bool:
    """Return whether there is something to record."""
    view = view_of(type(result))
    return bool(view.record) and view.recorded_if(result)


def recording_viewer(result: Result) -> Any:
    """Return the viewer of the recording, which a notebook's cell shows as its last line.

    Raises:
        LabError: there is nothing to record, or rerun-notebook is not installed (the extra ``notebook``).
    """
    if not is_recorded(result):
        raise LabError(f"the result of lab {result.command} has no recording; report(path) writes its page")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "recording.rrd"
        _write_recording(result, path)
        return viewer_of(path.read_bytes())


def viewer_of(recording: bytes) -> Any:
    """Return the viewer of a recording that was written.

    Raises:
        LabError: rerun-notebook is not installed (the extra ``notebook``).
    """
    from lab.report.recording import notebook_viewer

    return notebook_viewer(recording)


def draw(result: Result, folder: Path) -> None:
    """Write what is drawn into the folder of a run: figures, ``recording.rrd`` unless left out, and ``report.html``.

    The numbers are there before, and stay: what cannot be drawn is left out, with a warning.
    """
    if figures := view_of(type(result)).figures:
        attempted("the figures as files", lambda: load_reference(figures)(result, folder), _left_out)
    if is_recorded(result) and not getattr(result.options, "no_recording", False):
        attempted("recording.rrd", lambda: _write_recording(result, folder / "recording.rrd"), _left_out)
    attempted("report.html", lambda: write_page(result, folder / "report.html"), _left_out)


def _write_recording(result: Result, path: Path) -> None:
    with draft_file(path) as draft:
        load_reference(view_of(type(result)).record)(draft, result)


def write_page(result: Result, path: Path) -> None:
    """Write the page of a result, one HTML file that needs no network."""
    from lab.report.page import to_html

    with draft_file(path) as draft:  # a name of the user may have bytes that no character stands for
        draft.write_text(to_html(document_of(result)), encoding="utf-8", errors="backslashreplace")


def _left_out(missing: str) -> None:
    """Put nothing in place of a file that could not be made."""
