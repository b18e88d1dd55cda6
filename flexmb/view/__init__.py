"""Pictures of mechanisms and plots of time histories; VTK and matplotlib are loaded when needed.

Plots of error against wall time, which only studies draw, are in `work_precision`.
"""

from __future__ import annotations

from flexmb.view.modes import render_modes
from flexmb.view.picture import render
from flexmb.view.plot import history_figure, plot_history, save_figure

__all__ = ["history_figure", "plot_history", "render", "render_modes", "save_figure"]
