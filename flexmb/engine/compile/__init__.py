"""From the named, editable model to the flat tables of the engine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for editors and type checkers, which do not run __getattr__
    from flexmb.engine.compile.system import Compiled, compile_system

__all__ = ["Compiled", "compile_system"]


def __getattr__(name: str) -> Any:
    """Import on first use: the registry of kinds imports modules from here, which need it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from flexmb.engine.compile import system

    return getattr(system, name)
