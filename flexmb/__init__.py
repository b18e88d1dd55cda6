"""flexmb: flexible multibody dynamics, from a finite-element mesh to a moving, deforming machine.

Everything public has one place here and is loaded when it is first used, so that `import flexmb`
costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for editors and type checkers, which do not run __getattr__
    from flexmb.errors import FlexmbError, FlexmbWarning
    from flexmb.fe import reduce
    from flexmb.flexbody import FlexBody, rigid_body
    from flexmb.model import Model, load_scene, scene_schema
    from flexmb.results import Result, load_result
    from flexmb.studies import Study, study
    from flexmb.view import history_figure, plot_history, render, render_modes, save_figure
    from flexmb.workflow import (
        check_scene,
        kinematics,
        mobility,
        new_scene,
        resume,
        run_scene,
        simulate,
        warmup,
    )

__version__ = "0.1.0"

_HOMES = {
    "FlexBody": "flexmb.flexbody",
    "rigid_body": "flexmb.flexbody",
    "FlexmbError": "flexmb.errors",
    "FlexmbWarning": "flexmb.errors",
    "Model": "flexmb.model",
    "load_scene": "flexmb.model",
    "Result": "flexmb.results",
    "load_result": "flexmb.results",
    "reduce": "flexmb.fe",
    "render": "flexmb.view",
    "render_modes": "flexmb.view",
    "plot_history": "flexmb.view",
    "history_figure": "flexmb.view",
    "save_figure": "flexmb.view",
    "run_scene": "flexmb.workflow",
    "check_scene": "flexmb.workflow",
    "mobility": "flexmb.workflow",
    "simulate": "flexmb.workflow",
    "kinematics": "flexmb.workflow",
    "Study": "flexmb.studies",
    "study": "flexmb.studies",
    "resume": "flexmb.workflow",
    "new_scene": "flexmb.workflow",
    "scene_schema": "flexmb.model",
    "warmup": "flexmb.workflow",
}

__all__ = [
    "FlexBody",
    "FlexmbError",
    "FlexmbWarning",
    "Model",
    "Result",
    "Study",
    "check_scene",
    "history_figure",
    "kinematics",
    "load_result",
    "load_scene",
    "mobility",
    "new_scene",
    "plot_history",
    "reduce",
    "render",
    "render_modes",
    "resume",
    "rigid_body",
    "run_scene",
    "save_figure",
    "scene_schema",
    "simulate",
    "study",
    "warmup",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'flexmb' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
