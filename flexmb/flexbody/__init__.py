"""The flexible body and its file: all that the finite-element half passes to the multibody half."""

from __future__ import annotations

from flexmb.flexbody.body import FlexBody, rigid_body
from flexmb.flexbody.body_file import load, save
from flexmb.flexbody.membrane_stiffness import MembraneStiffness
from flexmb.flexbody.part_result import PartResult, load_part, save_part
from flexmb.flexbody.parts import Interface, LoadPoint, LoadVector, ModeInfo, NodeModes, Surface
from flexmb.flexbody.static_response import InertiaResponse, LoadResponse, OmittedModes
from flexmb.flexbody.stress_modes import (
    SectionForceModes,
    ShellForceModes,
    StressModes,
    principal_stresses,
    von_mises,
)

__all__ = [
    "FlexBody", "InertiaResponse", "Interface", "LoadPoint", "LoadResponse", "LoadVector",
    "MembraneStiffness", "ModeInfo", "NodeModes", "OmittedModes", "PartResult",
    "SectionForceModes", "ShellForceModes", "StressModes", "Surface", "load", "load_part",
    "principal_stresses", "rigid_body", "save", "save_part", "von_mises",
]  # fmt: skip
