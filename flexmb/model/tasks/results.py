"""What of a run is stored."""

from __future__ import annotations

from flexmb.model.values.quantities import Text
from flexmb.model.values.reading import Spec

__all__ = ["ResultsSpec"]


class ResultsSpec(Spec):
    """What the result file holds.

    ``keep`` names what is stored at each output, everything by default: groups (sensors, poses,
    modal-coordinates, velocities, coordinates, accelerations, reactions, multipliers, energy),
    bodies, joints, drivers, sensors, or channels, also with wildcards such as ``"rod.eta.*"``.
    Times and constraint drift are stored always, and so are channels of ``[[check]]`` and of
    ``[view] history``.
    """

    keep: tuple[Text, ...] = ()
