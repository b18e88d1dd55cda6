"""The flexible body and its file: all that the finite-element and multibody halves share."""

from __future__ import annotations

from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.file import load, save
from flexmb.flexbody.parts import Interface, LoadVector, ModeInfo, NodeModes, Surface
from flexmb.flexbody.recovery import (
    SECTION_FORCES,
    STRESS,
    SectionForceModes,
    StressModes,
    von_mises,
)
from flexmb.flexbody.rigid import rigid_body
from flexmb.flexbody.table import MODE_COLUMNS, mode_table

__all__ = [
    "MODE_COLUMNS",
    "SECTION_FORCES",
    "STRESS",
    "FlexBody",
    "Interface",
    "LoadVector",
    "ModeInfo",
    "NodeModes",
    "SectionForceModes",
    "StressModes",
    "Surface",
    "load",
    "mode_table",
    "rigid_body",
    "save",
    "von_mises",
]
