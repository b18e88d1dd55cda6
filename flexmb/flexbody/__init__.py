"""The flexible body and its file: all that the finite-element and multibody halves share."""

from __future__ import annotations

from flexmb.flexbody.body import MODE_COLUMNS, FlexBody, mode_table, rigid_body
from flexmb.flexbody.body_file import load, save
from flexmb.flexbody.part_result import STATIC, PartResult, load_part, save_part
from flexmb.flexbody.parts import Interface, LoadVector, ModeInfo, NodeModes, Surface
from flexmb.flexbody.static_response import InertiaResponse, LoadResponse, OmittedModes
from flexmb.flexbody.stress_modes import (
    SECTION_FORCES,
    SHELL_FORCES,
    STRESS,
    SectionForceModes,
    ShellForceModes,
    StressModes,
    principal_stresses,
    von_mises,
)

__all__ = [
    "MODE_COLUMNS", "SECTION_FORCES", "SHELL_FORCES", "STATIC", "STRESS", "FlexBody",
    "InertiaResponse", "Interface", "LoadResponse", "LoadVector", "ModeInfo", "NodeModes",
    "PartResult", "OmittedModes", "SectionForceModes", "ShellForceModes", "StressModes", "Surface",
    "load", "load_part", "mode_table", "principal_stresses", "rigid_body", "save", "save_part",
    "von_mises",
]  # fmt: skip
