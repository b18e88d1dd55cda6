"""The flexible body and its file: all that the finite-element and multibody halves share."""

from __future__ import annotations

from flexmb.flexbody.body import MODE_COLUMNS, FlexBody, mode_table, rigid_body
from flexmb.flexbody.body_file import load, save
from flexmb.flexbody.parts import (
    SECTION_FORCES,
    STRESS,
    Interface,
    LoadVector,
    ModeInfo,
    NodeModes,
    SectionForceModes,
    StressModes,
    Surface,
    von_mises,
)
from flexmb.flexbody.static_response import InertiaResponse, LoadResponse, OmittedModes

__all__ = [
    "MODE_COLUMNS",
    "SECTION_FORCES",
    "STRESS",
    "FlexBody",
    "InertiaResponse",
    "Interface",
    "LoadResponse",
    "LoadVector",
    "ModeInfo",
    "NodeModes",
    "OmittedModes",
    "SectionForceModes",
    "StressModes",
    "Surface",
    "load",
    "mode_table",
    "rigid_body",
    "save",
    "von_mises",
]
