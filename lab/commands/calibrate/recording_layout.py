"""How a recording opens: the arm large, the two ellipsoids beside it, plots below, text at hand."""

import numpy as np
import rerun.blueprint as rrb

from lab.commands.calibrate.run import CalibrationResult
from lab.commands.calibrate.scene import Scene
from lab.render.recording_layout import SUMMARY, bars, close_view, eye, layout, main_view

__all__ = ["CONVERGENCE", "PARAMETERS", "SINGULAR_VALUES", "blueprint"]

PARAMETERS, SINGULAR_VALUES, CONVERGENCE = "parameters", "singular_values", "convergence"


def blueprint(outcome: CalibrationResult, shown: Scene) -> rrb.Blueprint:
    """The layout of a campaign's recording."""
    before_mm, after_mm = (1e3 * float(np.nanmax(error)) for error in (shown.error_before, shown.error_after))
    unit = "in σ" if outcome.identification.sigma_known else "in mm"
    controls = eye(shown.origins, shown.all_measured, shown.reach_m, shown.T_world_instrument[:3, 3])
    left = rrb.Vertical(
        main_view("Arm, measured points, errors", controls),
        rrb.Horizontal(_errors("before", before_mm), _errors("after", after_mm)),
        row_shares=[3, 1],
    )
    texts = rrb.Tabs(
        rrb.TextDocumentView(origin=SUMMARY, name="Summary"),
        rrb.TextDocumentView(origin=PARAMETERS, name="Parameters"),
        active_tab=0,
    )
    charts = rrb.Horizontal(
        bars(SINGULAR_VALUES, "Singular values of J, scaled"),
        bars(f"{CONVERGENCE}/bars", f"RMS residual {unit}, by iteration"),
    )
    right = rrb.Vertical(_close_views(shown), texts, charts, row_shares=[1.3, 1.7, 0.9])
    return layout(left, right, "pose")


def _close_views(shown: Scene) -> rrb.Horizontal:
    """The target from near by, fixed in the middle, with one ellipsoid each."""
    views = [close_view("mapping", "Mapping ellipsoid", shown.reach_m)]
    if shown.uncertainty is not None:
        views.append(close_view("uncertainty", "Uncertainty ellipsoid", shown.reach_m))
    return rrb.Horizontal(*views)


def _errors(name: str, largest_mm: float) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"error_mm/{name}",
        name=f"Error {name}, mm, by pose",
        axis_y=rrb.ScalarAxis(range=(0.0, 1.08 * largest_mm)),
        plot_legend=rrb.PlotLegend(visible=False),
    )
