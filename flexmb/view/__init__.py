"""Pictures of mechanisms and plots of time histories; VTK and matplotlib are loaded when needed."""

from __future__ import annotations

from flexmb.view.film import film
from flexmb.view.modes import render_modes
from flexmb.view.picture import render
from flexmb.view.plot import history_figure, plot_history, save_figure

__all__ = ["film", "history_figure", "plot_history", "render", "render_modes", "save_figure"]
