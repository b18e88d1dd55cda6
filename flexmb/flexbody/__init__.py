"""The flexible body and its file: all that the finite-element and multibody halves share."""

from __future__ import annotations

from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.file import load, save
from flexmb.flexbody.parts import Interface, ModeInfo, NodeModes, Surface
from flexmb.flexbody.rigid import rigid_body
from flexmb.flexbody.table import MODE_COLUMNS, mode_table

__all__ = [
    "MODE_COLUMNS",
    "FlexBody",
    "Interface",
    "ModeInfo",
    "NodeModes",
    "Surface",
    "load",
    "mode_table",
    "rigid_body",
    "save",
]
