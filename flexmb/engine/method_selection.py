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
"""The method to which a run with "auto" changes if stiffness limits the steps."""

NONSTIFF_METHOD = "explicit-rk"
"""The method of a run with "auto" that is not stiff: it reaches the smallest errors."""


@cache
def method_makers() -> dict[str, Callable[[DynamicsSpec], Method]]:
    """Functions that make a method for a scene, by name, from `METHODS` of all integrators."""
    modules = [
        import_module(f"{integrators.__name__}.{file.name}")
        for file in iter_modules(integrators.__path__)
    ]
    return {
        name: maker for module in modules for name, maker in getattr(module, "METHODS", {}).items()
    }


def method_name(spec: DynamicsSpec, implicit: str = "") -> str:
    """The integrator with which a run begins; `implicit`: why it must be implicit, or ""."""
    if spec.method != AUTO:
        return spec.method
    if spec.step is not None:
        return "generalized-alpha"
    return STIFF_METHOD if implicit else NONSTIFF_METHOD


def reason_of_method(spec: DynamicsSpec, name: str, implicit: str) -> str:
    """Why `method = "auto"` selects this method; "" if the scene names its method."""
    if spec.method != AUTO:
        return ""
    if spec.step is not None:
        return "fixed steps"
    if name != STIFF_METHOD:
        return "nothing stiff"
    return implicit or "stability limits the steps of explicit-rk"


def make_integrator(spec: DynamicsSpec, name: str | None = None) -> Method:
    """The integrator with this name for a scene, by default that of `dynamics.method`."""
    return method_makers()[name or method_name(spec)](spec)
