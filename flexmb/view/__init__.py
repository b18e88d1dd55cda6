"""Pictures of mechanisms and plots of time histories; VTK and matplotlib are loaded when needed."""

from __future__ import annotations

from flexmb.view.film import film
from flexmb.view.history import history_figure, plot_history
from flexmb.view.modes import film_modes, render_modes
from flexmb.view.part_pictures import render_part
from flexmb.view.picture import render
from flexmb.view.plot import save_figure
from flexmb.view.window import animation, open_window, snapshot

__all__ = [
    "animation", "film", "film_modes", "history_figure", "open_window", "plot_history", "render",
    "render_modes", "render_part", "save_figure", "snapshot",
]  # fmt: skip
