"""Pages, pictures and recordings left out: they take most of a command's time."""

import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from markupsafe import Markup

from lab.report import view

_PAGE = view.write_page


@contextmanager
def nothing_drawn(*, pages: bool = False) -> Iterator[None]:
    """Leave out the drawings of results: recordings are empty files, and studies have no figures.

    Args:
        pages: write pages, with empty pictures; else they are empty files, too.
    """
    with pytest.MonkeyPatch.context() as patch:
        study_figures = types.ModuleType("lab.report.views.study_figures")
        study_figures.pictures_of = lambda _: {}
        study_figures.write_pictures = lambda *_: None
        patch.setitem(sys.modules, study_figures.__name__, study_figures)
        patch.setattr("lab.report.charts.chart.inline_svg", lambda picture: Markup())
        patch.setattr(view, "_write_recording", lambda result, path: path.write_bytes(b""))
        patch.setattr(view, "write_page", _PAGE if pages else lambda result, path: path.write_bytes(b""))
        yield
