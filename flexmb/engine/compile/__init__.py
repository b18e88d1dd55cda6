"""From the named, editable model to the flat tables of the engine."""

from flexmb.engine.compile.system import Compiled, compile_system

__all__ = ["Compiled", "compile_system"]
