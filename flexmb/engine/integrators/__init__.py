"""The methods that a scene can name: each is the file of its name, which says `make_method`.

Their words are `model.tasks.methods`; the contract is in `engine.method`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flexmb.engine.method import Method

if TYPE_CHECKING:  # compilers of units import this package, and need no scenes
    from flexmb.model.tasks.dynamics import DynamicsSpec

__all__ = ["AUTO", "STIFF_METHOD", "chosen_method", "import_methods", "method_name"]

AUTO = "auto"
STIFF_METHOD = "radau"
"""What a run by "auto" goes over to where stiffness limits the steps."""


def _module(name: str) -> Any:
    return import_module(f"{__name__}.{name.replace('-', '_')}")


def method_name(spec: DynamicsSpec, flexible: bool = False) -> str:
    """The integrator that a run begins with; `flexible` if the model has flexible bodies."""
    if spec.method != AUTO:
        return spec.method
    if spec.step is not None:
        return "generalized-alpha"
    return STIFF_METHOD if flexible else "explicit-rk"


def chosen_method(spec: DynamicsSpec, name: str | None = None) -> Method:
    """The integrator of a name, by default that of `dynamics.method`, with the numbers of a run."""
    method: Method = _module(name or method_name(spec)).make_method(spec)
    return method


def import_methods() -> None:
    """Import all methods, so that their units are known."""
    from flexmb.model.tasks.methods import METHODS

    for name in METHODS:
        if name != AUTO:
            _module(name)
