"""The methods that a scene can name: each is the file of its name, which says `make_method`.

Their words are `model.tasks.methods`; the contract is in `engine.method`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flexmb.engine.method import Method

if TYPE_CHECKING:  # compilers of units import this package, and need no scenes
    from flexmb.model.tasks.dynamics import DynamicsSpec

__all__ = ["chosen_method", "import_methods"]


def _module(name: str) -> Any:
    return import_module(f"{__name__}.{name.replace('-', '_')}")


def chosen_method(spec: DynamicsSpec) -> Method:
    """The integrator of `dynamics.method`."""
    method: Method = _module(spec.method).make_method(spec)
    return method


def import_methods() -> None:
    """Import all methods, so that their units are known."""
    from flexmb.model.tasks.methods import METHODS

    for name in METHODS:
        _module(name)
