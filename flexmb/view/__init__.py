"""Pictures of mechanisms and plots of time histories; VTK and matplotlib are loaded when needed."""

from __future__ import annotations

from flexmb.view.modes import render_modes
from flexmb.view.picture import render
from flexmb.view.plot import history_figure, plot_history, save_figure
from flexmb.view.work_precision import Curve, pareto_figure, work_precision_figure

__all__ = [
    "Curve",
    "history_figure",
    "pareto_figure",
    "plot_history",
    "render",
    "render_modes",
    "save_figure",
    "work_precision_figure",
]
