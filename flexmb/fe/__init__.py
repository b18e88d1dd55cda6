"""The finite-element half: mesh in, flexible body out. The only home of scikit-fem and meshio."""

from __future__ import annotations

from flexmb.fe.assembly.assemble import FEMatrices, assemble
from flexmb.fe.assembly.geometric import geometric_stiffness
from flexmb.fe.assembly.loads import LoadPattern, make_loads
from flexmb.fe.checks.mesh import Finding, mesh_report
from flexmb.fe.checks.phases import Stopwatch
from flexmb.fe.checks.quality import QualityReport, quality_report
from flexmb.fe.checks.quality_text import report_tables, report_text
from flexmb.fe.checks.survey import Survey, mesh_problems, survey
from flexmb.fe.elements.registry import ELEMENTS
from flexmb.fe.elements.select import Block
from flexmb.fe.interfaces.make import make_interfaces
from flexmb.fe.interfaces.rigid import RigidInterface
from flexmb.fe.interfaces.weighted import WeightedInterface
from flexmb.fe.key import reduction_key
from flexmb.fe.material import resolve
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.reader import read_mesh
from flexmb.fe.meshes.table import mesh_from
from flexmb.fe.recovery.nodes import node_modes, surface
from flexmb.fe.recovery.section_forces import SectionForces, section_force_modes
from flexmb.fe.reduce import make_body, reduce
from flexmb.fe.reduction.basis import ReducedBasis
from flexmb.fe.reduction.choice import ModeChoice
from flexmb.fe.reduction.craig_bampton import craig_bampton, guyan
from flexmb.fe.reduction.free_interface import free_interface
from flexmb.fe.reduction.integrals import Integrals, integrals
from flexmb.fe.reduction.methods import METHODS, reduce_model
from flexmb.fe.reduction.orthonormal import ReducedModes, orthonormalise
from flexmb.fe.reduction.user import user_modes
from flexmb.fe.sections.angle import angle_section
from flexmb.fe.sections.beam import BeamSection, general
from flexmb.fe.sections.beam_shapes import circle, rectangle, tube
from flexmb.fe.sections.read import section_from
from flexmb.fe.sections.shell import Layer, ShellSection, layered, shell
from flexmb.fe.sections.solid import SolidSection
from flexmb.fe.sections.taper import TaperedSection, tapered
from flexmb.fe.sections.thin_walls import box_section, i_section

__all__ = [
    "ELEMENTS",
    "METHODS",
    "BeamSection",
    "Block",
    "FEMatrices",
    "Finding",
    "Integrals",
    "Layer",
    "LoadPattern",
    "Mesh",
    "ModeChoice",
    "QualityReport",
    "ReducedBasis",
    "ReducedModes",
    "RigidInterface",
    "SectionForces",
    "ShellSection",
    "SolidSection",
    "Stopwatch",
    "Survey",
    "TaperedSection",
    "WeightedInterface",
    "angle_section",
    "assemble",
    "box_section",
    "circle",
    "craig_bampton",
    "free_interface",
    "general",
    "geometric_stiffness",
    "guyan",
    "i_section",
    "integrals",
    "layered",
    "make_body",
    "make_interfaces",
    "make_loads",
    "mesh_from",
    "mesh_problems",
    "mesh_report",
    "node_modes",
    "orthonormalise",
    "quality_report",
    "read_mesh",
    "rectangle",
    "reduce",
    "reduce_model",
    "reduction_key",
    "report_tables",
    "report_text",
    "resolve",
    "section_force_modes",
    "section_from",
    "shell",
    "surface",
    "survey",
    "tapered",
    "tube",
    "user_modes",
]
