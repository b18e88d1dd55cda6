"""The finite-element half: mesh in, flexible body out. The only home of scikit-fem and meshio."""

from __future__ import annotations

from flexmb.fe.assembly.assemble import FEMatrices, assemble
from flexmb.fe.assembly.geometric import geometric_stiffness
from flexmb.fe.checks.precheck import mesh_problems
from flexmb.fe.elements.registry import ELEMENTS
from flexmb.fe.elements.select import Block
from flexmb.fe.interfaces.rigid import RigidInterface, make_interfaces
from flexmb.fe.key import reduction_key
from flexmb.fe.material import resolve
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.reader import read_mesh
from flexmb.fe.recovery.nodes import node_modes, surface
from flexmb.fe.recovery.section_forces import SectionForces, section_force_modes
from flexmb.fe.reduce import make_body, reduce
from flexmb.fe.reduction.craig_bampton import CraigBampton, craig_bampton
from flexmb.fe.reduction.integrals import Integrals, integrals
from flexmb.fe.reduction.orthonormal import ReducedModes, orthonormalise
from flexmb.fe.sections.angle import angle_section
from flexmb.fe.sections.beam import BeamSection, general
from flexmb.fe.sections.beam_shapes import circle, rectangle, tube
from flexmb.fe.sections.read import section_from
from flexmb.fe.sections.solid import SolidSection
from flexmb.fe.sections.taper import TaperedSection, tapered
from flexmb.fe.sections.thin_walls import box_section, i_section

__all__ = [
    "ELEMENTS",
    "BeamSection",
    "CraigBampton",
    "Block",
    "FEMatrices",
    "Integrals",
    "Mesh",
    "ReducedModes",
    "RigidInterface",
    "SectionForces",
    "SolidSection",
    "TaperedSection",
    "angle_section",
    "assemble",
    "box_section",
    "circle",
    "craig_bampton",
    "geometric_stiffness",
    "general",
    "i_section",
    "integrals",
    "make_body",
    "make_interfaces",
    "mesh_problems",
    "node_modes",
    "orthonormalise",
    "read_mesh",
    "rectangle",
    "reduce",
    "reduction_key",
    "resolve",
    "section_force_modes",
    "section_from",
    "surface",
    "tapered",
    "tube",
]
