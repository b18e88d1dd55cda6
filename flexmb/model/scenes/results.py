"""What of a run is stored, drawn, and compared with known answers."""

from __future__ import annotations

from typing import Annotated

from flexmb.model.values.quantities import Axis, Integer, Measured, Quantity, Text, WordOr
from flexmb.model.values.reading import Spec


class ResultsSpec(Spec):
    """What the result file holds.

    ``keep`` names what is stored at each output, everything by default: groups (sensors, poses,
    modal-coordinates, velocities, coordinates, accelerations, reactions, multipliers, energy),
    bodies, joints, drivers, sensors, or channels, also with wildcards such as ``"rod.eta.*"``.
    Times and constraint drift are stored always, and so are channels of ``[[check]]`` and of
    ``[view] history``.
    """

    keep: tuple[Text, ...] = ()


_PIXELS = Integer(64)  # smaller pictures show nothing


class ViewSpec(Spec):
    """Picture and plot of a run.

    ``time`` of the picture, default the end; ``exaggeration`` of the deformation, ``"auto"``
    chooses a round factor; ``direction`` from the scene towards the eye, default along the joint
    axes; ``history`` the channels of the plot, default all; ``size`` in pixels.
    """

    time: Annotated[float, Quantity("s", "not negative")] | None = None
    exaggeration: Annotated[float | str, WordOr("auto", "a factor", "", "not negative")] = "auto"
    direction: Axis | None = None
    history: tuple[Text, ...] = ()
    size: tuple[Annotated[int, _PIXELS], Annotated[int, _PIXELS]] = (1280, 720)


class CheckSpec(Spec):
    """At ``time`` the channel ``sensor`` is ``value`` within ``tolerance``, says ``source``."""

    sensor: Text
    time: Annotated[float, Quantity("s", "not negative")]
    value: Annotated[float, Measured()]
    tolerance: Annotated[float, Measured(sign="positive")]
    source: Text


class FrequencyCheckSpec(Spec):
    """Natural frequency number ``mode`` of the flexible ``body`` is ``value`` within ``tolerance``.

    ``held`` names interfaces that do not move; without any the body is free, and its rigid motions
    do not count.
    """

    body: Text
    held: tuple[Text, ...] = ()
    mode: Annotated[int, Integer(1)] = 1
    value: Annotated[float, Quantity("Hz", "positive")]
    tolerance: Annotated[float, Quantity("Hz", "positive")]
    source: Text
