"""flexmb: flexible multibody dynamics, from a finite-element mesh to a moving, deforming machine.

Everything public has one place here and is loaded when it is first used, so that `import flexmb`
costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for editors and type checkers, which do not run __getattr__
    from flexmb.errors import FlexmbError, FlexmbWarning
    from flexmb.fe import part, reduce
    from flexmb.flexbody import FlexBody, rigid_body
    from flexmb.model import Model, load_scene, scene_schema
    from flexmb.results import Result, load_result
    from flexmb.studies.accuracy.report import Study
    from flexmb.studies.accuracy.runner import study
    from flexmb.studies.budgets.budget_report import Budget
    from flexmb.studies.budgets.error_budget import budget
    from flexmb.studies.sweeps.parameter_sweep import sweep
    from flexmb.studies.sweeps.sweep_report import Sweep
    from flexmb.view.film import film
    from flexmb.view.history import history_figure, plot_history
    from flexmb.view.modes import film_modes, render_modes
    from flexmb.view.picture import render
    from flexmb.view.plot import save_figure
    from flexmb.view.window import animation, open_window, snapshot
    from flexmb.workflow.audit import audit
    from flexmb.workflow.check import check_scene, mobility
    from flexmb.workflow.comparison import compare
    from flexmb.workflow.drive_forces import inverse_dynamics
    from flexmb.workflow.equilibria import equilibria, free_lengths, sweep_statics
    from flexmb.workflow.installation import warmup
    from flexmb.workflow.linearize import linearize, render_mode_shapes, sweep_modes
    from flexmb.workflow.listings import new_scene
    from flexmb.workflow.part_analysis import run_part
    from flexmb.workflow.result_page import report, report_page
    from flexmb.workflow.resume import resume
    from flexmb.workflow.simulate import iterate_motion, kinematics, run_scene, simulate, statics

__version__ = "0.1.0"
__all__ = [
    "Budget", "FlexBody", "FlexmbError", "FlexmbWarning", "Model", "Result", "Study", "Sweep",
    "animation", "audit", "budget", "check_scene", "compare", "equilibria", "film", "film_modes",
    "free_lengths", "history_figure", "inverse_dynamics", "iterate_motion", "kinematics",
    "linearize", "load_result", "load_scene", "mobility", "new_scene", "open_window", "part",
    "plot_history", "reduce", "render", "render_mode_shapes", "render_modes", "report",
    "report_page", "resume", "rigid_body", "run_part", "run_scene", "save_figure", "scene_schema",
    "simulate", "snapshot", "statics", "study", "sweep", "sweep_modes", "sweep_statics", "warmup",
]  # fmt: skip

_HOMES = {
    "errors": ("FlexmbError", "FlexmbWarning"),
    "fe": ("part", "reduce"),
    "flexbody": ("FlexBody", "rigid_body"),
    "model": ("Model", "load_scene", "scene_schema"),
    "results": ("Result", "load_result"),
    "studies.accuracy.report": ("Study",),
    "studies.accuracy.runner": ("study",),
    "studies.budgets.budget_report": ("Budget",),
    "studies.budgets.error_budget": ("budget",),
    "studies.sweeps.parameter_sweep": ("sweep",),
    "studies.sweeps.sweep_report": ("Sweep",),
    "view.film": ("film",),
    "view.history": ("history_figure", "plot_history"),
    "view.modes": ("film_modes", "render_modes"),
    "view.picture": ("render",),
    "view.plot": ("save_figure",),
    "view.window": ("animation", "open_window", "snapshot"),
    "workflow.audit": ("audit",),
    "workflow.check": ("check_scene", "mobility"),
    "workflow.comparison": ("compare",),
    "workflow.drive_forces": ("inverse_dynamics",),
    "workflow.equilibria": ("equilibria", "free_lengths", "sweep_statics"),
    "workflow.installation": ("warmup",),
    "workflow.linearize": ("linearize", "render_mode_shapes", "sweep_modes"),
    "workflow.listings": ("new_scene",),
    "workflow.part_analysis": ("run_part",),
    "workflow.result_page": ("report", "report_page"),
    "workflow.resume": ("resume",),
    "workflow.simulate": ("iterate_motion", "kinematics", "run_scene", "simulate", "statics"),
}


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f"flexmb.{home}"), name)
    raise AttributeError(f"module 'flexmb' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
