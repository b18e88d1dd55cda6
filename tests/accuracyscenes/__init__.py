"""Scenes whose motion is known without flexmb: in closed form or from a textbook's equations."""

from __future__ import annotations

from .contacts import CONTACTS
from .control import CONTROL
from .drives import DRIVES
from .heldout import HELD_OUT
from .linkages import LINKAGES
from .machines import MACHINES
from .mounts import MOUNTS
from .orbits import ORBITS
from .oscillators import OSCILLATORS
from .pendulums import PENDULUMS
from .scene import AWAY, Scene, beside_a_large_motion, far_apart, moved, truth_of
from .spinning import SPINNING
from .states import STATES
from .switches import SWITCHES
from .transmissions import TRANSMISSIONS

__all__ = [
    "AWAY",
    "CYCLES",
    "HELD_OUT",
    "SCENES",
    "Scene",
    "beside_a_large_motion",
    "far_apart",
    "moved",
    "truth_of",
]

SCENES = {
    **PENDULUMS,
    **SPINNING,
    **ORBITS,
    **OSCILLATORS,
    **MACHINES,
    **STATES,
    **CONTACTS,
    **HELD_OUT,
    **DRIVES,
    **LINKAGES,
    **MOUNTS,
    **SWITCHES,
    **CONTROL,
    **TRANSMISSIONS,
}

CYCLES = {
    "pendulum": 1930.0,
    "mass on a spring": 611.0,
    "Foucault's pendulum": 2034.0,
    "orbit, e = 0.6": 6113.0,
    "free top": 1070.0,
    "gears": 1933.0,
    "driven slider-crank": 305.5,
    "bead on a cycloid": 1235.0,
    "inverted pendulum": 61.3,
    "bouncing ball": 632.0,
    "mass between stops": 645.0,
}
"""Scenes, and how long 973 of their swings, turns or shakes take [s]: no whole number of a row."""
