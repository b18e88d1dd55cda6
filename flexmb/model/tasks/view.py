"""What to draw of a run: the picture's time and direction, and the history plot's channels."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ValidationInfo

from flexmb.errors import Problem
from flexmb.model.values.quantities import Axis, Integer, Quantity, Text
from flexmb.model.values.reading import Reader, Spec, fail, given

__all__ = ["ViewSpec"]

_PIXELS = Integer(64)  # smaller pictures show nothing


def _exaggeration(value: Any, info: ValidationInfo) -> float | str:
    if value == "auto":
        return "auto"
    if isinstance(value, str) and value.isalpha() and value not in (info.context or {}):
        what = f"a factor is expected, given {given(value)}"
        raise fail(Problem("", what, ("auto", "a number or an expression")))
    return Quantity("", "not negative").read(value, info)


class ViewSpec(Spec):
    """Picture and plot of a run.

    ``time`` of the picture, default the end; ``exaggeration`` of the deformation, ``"auto"``
    chooses a round factor; ``direction`` from the scene towards the eye, default along the joint
    axes; ``history`` the channels of the plot, default all; ``size`` in pixels.
    """

    time: Annotated[float, Quantity("s", "not negative")] | None = None
    exaggeration: Annotated[float | str, Reader(_exaggeration)] = "auto"
    direction: Axis | None = None
    history: tuple[Text, ...] = ()
    size: tuple[Annotated[int, _PIXELS], Annotated[int, _PIXELS]] = (1280, 720)
