"""The finite-element half: mesh in, flexible body out. The only home of scikit-fem and meshio."""

from __future__ import annotations

from flexmb.fe.assembly.assemble import FEMatrices, assemble, geometric_stiffness
from flexmb.fe.assembly.interfaces import RigidInterface, WeightedInterface, make_interfaces
from flexmb.fe.assembly.loads import LoadPattern, make_loads
from flexmb.fe.displacements import node_modes, surface
from flexmb.fe.elements.element_blocks import Block
from flexmb.fe.mesh_checks import Finding, mesh_report
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.mesh_file import read_mesh
from flexmb.fe.meshes.mesh_shapes import mesh_from
from flexmb.fe.model_checks import Survey
from flexmb.fe.reduce import make_body, reduce, survey
from flexmb.fe.reduction.component_modes import craig_bampton, free_interface, guyan
from flexmb.fe.reduction.methods import reduce_model
from flexmb.fe.reduction.quality_report import QualityReport, quality_report
from flexmb.fe.reduction.reduced_basis import (
    Integrals,
    ReducedBasis,
    ReducedModes,
    integrals,
    orthonormalise,
)
from flexmb.fe.reduction.user_modes import user_modes
from flexmb.fe.sections.beam_chain import TaperedSection, tapered
from flexmb.fe.sections.beam_section import BeamSection, general
from flexmb.fe.sections.section_tables import (
    SolidSection,
    circle,
    rectangle,
    resolve,
    section_from,
    tube,
)
from flexmb.fe.sections.shell_section import Layer, ShellSection, layered, shell
from flexmb.fe.sections.thin_walls import angle_section, box_section, i_section
from flexmb.fe.solve_part import part
from flexmb.fe.stress import SectionForces
from flexmb.flexbody.mesh_options import ModesOptions

__all__ = [
    "BeamSection", "Block", "FEMatrices", "Finding", "Integrals", "Layer", "LoadPattern", "Mesh",
    "ModesOptions", "QualityReport", "ReducedBasis", "ReducedModes", "RigidInterface",
    "SectionForces", "ShellSection", "SolidSection", "Survey", "TaperedSection",
    "WeightedInterface", "angle_section", "assemble", "box_section", "circle", "craig_bampton",
    "free_interface", "general", "geometric_stiffness", "guyan", "i_section", "integrals",
    "layered", "make_body", "make_interfaces", "make_loads", "mesh_from", "mesh_report",
    "node_modes", "orthonormalise", "part", "quality_report", "read_mesh", "rectangle", "reduce",
    "reduce_model", "resolve", "section_from", "shell", "surface", "survey", "tapered", "tube",
    "user_modes",
]  # fmt: skip
