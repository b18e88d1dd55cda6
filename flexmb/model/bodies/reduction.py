"""How a mesh becomes modes: the method, how many, and the loads that they shall answer exactly.

In: the words of a scene. Out: numbers and specifications in SI with the words of
``flexmb.fe.reduction``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.values.quantities import Integer, Quantity
from flexmb.model.values.reading import Reader, Spec, fail, given, names_of, read_entry

__all__ = ["METHODS", "Method", "Modes", "ModesSpec", "mode_count"]

Method = Literal["craig-bampton", "free-interface", "guyan", "user"]

METHODS = {
    "craig-bampton": "static modes of the interfaces and modes with the interfaces held: "
    "6 interfaces + modes - 6 coordinates",
    "free-interface": "modes of the free body and residual attachment modes: up to modes + "
    "6 interfaces coordinates",
    "guyan": "static modes of the interfaces alone: 6 interfaces - 6 coordinates",
    "user": "modes of an .npz file, by modes = path",
}
"""What each method keeps."""


class ModesSpec(Spec):
    """How many modes: a count, those below a frequency, a share of effective interface mass."""

    count: Annotated[int, Integer(0)] | None = None
    frequency: Annotated[float, Quantity("Hz", "positive")] | None = None
    effective_mass: Annotated[float, Quantity("", "positive")] | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        words = ("count", "frequency", "effective_mass")
        told = [key for key in words if getattr(self, key) is not None]
        if len(told) != 1:
            what = f"give one of them, given {' and '.join(told) or 'none'}"
            raise fail(Problem("", what, words))
        if self.effective_mass is not None and self.effective_mass >= 1:
            what = f"must be a share below 1, is {self.effective_mass:g}"
            raise fail(Problem("effective_mass", what))
        return self


def _read_modes(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, Mapping | ModesSpec):
        spec, problems = read_entry(ModesSpec, value, names_of(info))
        if spec is None:
            raise fail(*problems)
        return spec
    if isinstance(value, Path) or (isinstance(value, str) and value.strip().endswith(".npz")):
        return Path(value).as_posix()
    if isinstance(value, list | tuple):
        what = f"a whole number, a table or an .npz file is expected, given {given(value)}"
        raise fail(Problem("", what))
    return Integer(0).read(value, info)


def _write_modes(value: Any, info: SerializationInfo) -> Any:
    if not isinstance(value, ModesSpec):
        return value
    return value.model_dump(mode="json", exclude_none=True, context=info.context)


Modes = Annotated[Any, Reader(_read_modes, _write_modes)]
"""A number of modes, a :class:`ModesSpec`, or the .npz file of the user's own."""


def mode_count(modes: Any, default: int = 20) -> int:
    """How many modes are asked for by number; the default where it is not told by number."""
    if isinstance(modes, ModesSpec):
        return default if modes.count is None else modes.count
    return modes if isinstance(modes, int) else default
