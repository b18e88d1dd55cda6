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
    from flexmb.studies import Budget, Study, Sweep, budget, study, sweep
    from flexmb.view import (
        animation,
        film,
        film_modes,
        history_figure,
        open_window,
        plot_history,
        render,
        render_modes,
        save_figure,
        snapshot,
    )
    from flexmb.workflow import (
        audit,
        check_scene,
        compare,
        equilibria,
        free_lengths,
        inverse_dynamics,
        iterate_motion,
        kinematics,
        linearize,
        mobility,
        new_scene,
        render_mode_shapes,
        resume,
        run_part,
        run_scene,
        simulate,
        statics,
        sweep_modes,
        sweep_statics,
        warmup,
    )
    from flexmb.workflow.result_page import report, report_page

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
    "studies": ("Budget", "Study", "Sweep", "budget", "study", "sweep"),
    "view": (
        "animation", "film", "film_modes", "history_figure", "open_window", "plot_history",
        "render", "render_modes", "save_figure", "snapshot",
    ),
    "workflow": (
        "audit", "check_scene", "compare", "equilibria", "free_lengths", "inverse_dynamics",
        "iterate_motion", "kinematics", "linearize", "mobility", "new_scene", "render_mode_shapes",
        "resume", "run_part", "run_scene", "simulate", "statics", "sweep_modes", "sweep_statics",
        "warmup",
    ),
    "workflow.result_page": ("report", "report_page"),
}  # fmt: skip


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f"flexmb.{home}"), name)
    raise AttributeError(f"module 'flexmb' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
