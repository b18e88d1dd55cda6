"""The integrator of a run: the one that the scene names, or that "auto" selects."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from flexmb.engine import integrators
from flexmb.engine.method import Method

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec


AUTO = "auto"

STIFF_METHOD = "radau"
"""What a run by "auto" goes over to where stiffness limits the steps."""

NONSTIFF_METHOD = "explicit-rk"
"""What reaches the smallest errors where nothing is stiff."""


@cache
def method_makers() -> dict[str, Callable[[DynamicsSpec], Method]]:
    """What makes each method for a scene, by name: the tables `METHODS` of all files."""
    modules = [
        import_module(f"{integrators.__name__}.{file.name}")
        for file in iter_modules(integrators.__path__)
    ]
    return {
        name: maker for module in modules for name, maker in getattr(module, "METHODS", {}).items()
    }


def method_name(spec: DynamicsSpec, implicit: str = "") -> str:
    """The integrator that a run begins with; `implicit`: why explicit ones are none for it."""
    if spec.method != AUTO:
        return spec.method
    if spec.step is not None:
        return "generalized-alpha"
    return STIFF_METHOD if implicit else NONSTIFF_METHOD


def reason_of_method(spec: DynamicsSpec, name: str, implicit: str) -> str:
    """Why `method = "auto"` has chosen it; nothing where the scene names its method."""
    if spec.method != AUTO:
        return ""
    if spec.step is not None:
        return "fixed steps"
    if name != STIFF_METHOD:
        return "nothing stiff"
    return implicit or "stability limits the steps of explicit-rk"


def make_integrator(spec: DynamicsSpec, name: str | None = None) -> Method:
    """The integrator of a name, by default that of `dynamics.method`, for a scene."""
    return method_makers()[name or method_name(spec)](spec)
