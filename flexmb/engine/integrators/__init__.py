"""The methods that a scene can name: for each, what makes it.

Their words are `model.tasks.methods`; the contract is in `engine.method`.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING

from flexmb.engine.method import Method

if TYPE_CHECKING:  # compilers of units import this package, and need no scenes
    from flexmb.model.scenes.dynamics import DynamicsSpec

__all__ = [
    "AUTO",
    "FINE_METHOD",
    "STIFF_METHOD",
    "chosen_method",
    "import_methods",
    "method_name",
    "reason_of_method",
]

AUTO = "auto"
STIFF_METHOD = "radau"
"""What a run by "auto" goes over to where stiffness limits the steps."""
FINE_METHOD = "explicit-rk"
"""What reaches the smallest errors where nothing is stiff."""


_MAKERS = {
    "generalized-alpha": "generalized_alpha.make_method",
    "hht": "generalized_alpha.make_hht",
    "newmark": "generalized_alpha.make_newmark",
    "trapezoidal": "generalized_alpha.make_trapezoidal",
    "explicit-rk": "explicit_rk.make_method",
    "baumgarte": "baumgarte.make_method",
    "coordinate-partitioning": "coordinate_partitioning.make_method",
    "radau": "radau.make_method",
}
"""File of each method, and the function there that makes it for a scene."""


def _maker(name: str) -> Callable[[DynamicsSpec], Method]:
    file, _, function = _MAKERS[name].partition(".")
    maker: Callable[[DynamicsSpec], Method] = getattr(import_module(f"{__name__}.{file}"), function)
    return maker


def method_name(spec: DynamicsSpec, flexible: bool = False) -> str:
    """The integrator that a run begins with; `flexible` if the model has flexible bodies."""
    if spec.method != AUTO:
        return spec.method
    if spec.step is not None:
        return "generalized-alpha"
    return STIFF_METHOD if flexible else FINE_METHOD


def reason_of_method(spec: DynamicsSpec, name: str, flexible: bool) -> str:
    """Why `method = "auto"` has chosen it; nothing where the scene names its method."""
    if spec.method != AUTO:
        return ""
    if spec.step is not None:
        return "fixed steps"
    if name != STIFF_METHOD:
        return "nothing stiff"
    return "flexible bodies" if flexible else "stability limits the steps of explicit-rk"


def chosen_method(spec: DynamicsSpec, name: str | None = None) -> Method:
    """The integrator of a name, by default that of `dynamics.method`, with the numbers of a run."""
    return _maker(name or method_name(spec))(spec)


def import_methods() -> None:
    """Import all methods, so that their units are known."""
    for name in _MAKERS:
        _maker(name)
