"""The methods that a scene can name: for each, what makes it.

A method is a file here with a table `METHODS`, and a line of words in `model.scenes.dynamics`; the
contract is in `engine.method`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from flexmb.engine.method import Method

if TYPE_CHECKING:  # compilers of units import this package, and need no scenes
    from flexmb.model.scenes.dynamics import DynamicsSpec

__all__ = [
    "AUTO",
    "FINE_METHOD",
    "STIFF_METHOD",
    "make_integrator",
    "import_methods",
    "method_name",
    "reason_of_method",
]

AUTO = "auto"
STIFF_METHOD = "radau"
"""What a run by "auto" goes over to where stiffness limits the steps."""
FINE_METHOD = "explicit-rk"
"""What reaches the smallest errors where nothing is stiff."""


@cache
def _makers() -> dict[str, Callable[[DynamicsSpec], Method]]:
    """What makes each method for a scene, by name: the tables `METHODS` of all files here."""
    modules = [import_module(f"{__name__}.{file.name}") for file in iter_modules(__path__)]
    return {
        name: maker for module in modules for name, maker in getattr(module, "METHODS", {}).items()
    }


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


def make_integrator(spec: DynamicsSpec, name: str | None = None) -> Method:
    """The integrator of a name, by default that of `dynamics.method`, for a scene."""
    return _makers()[name or method_name(spec)](spec)


def import_methods() -> None:
    """Import all methods, so that their units are known."""
    _makers()
