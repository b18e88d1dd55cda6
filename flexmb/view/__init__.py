"""Pictures of mechanisms and plots of time histories; VTK and matplotlib are loaded when needed."""

from __future__ import annotations

from flexmb.view.history import history_figure, plot_history
from flexmb.view.modes import render_modes
from flexmb.view.picture import render
from flexmb.view.plot import save_figure

__all__ = ["history_figure", "plot_history", "render", "render_modes", "save_figure"]
