"""From a mesh to a flexible body in one call.

In: a mesh with its unit system, a material, named interfaces, a number of modes. Out: a
:class:`FlexBody` in SI. Each step (read, assemble, reduce, orthonormalise, integrals, recovery) is
a function of its own in this package.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from skfem import CellBasis
from skfem import Mesh as SkfemMesh

from flexmb.errors import FlexmbWarning, MaterialError, MeshError, Problem
from flexmb.fe.assembly.assemble import (
    FEMatrices,
    MeshModel,
    ProblemCollector,
    assemble_model,
    make_model,
)
from flexmb.fe.assembly.interfaces import (
    InterfaceLike,
    ModelInterface,
    RigidInterface,
    make_interfaces,
    select_interface,
)
from flexmb.fe.assembly.loads import load_options, make_loads, reduce_load
from flexmb.fe.displacements import node_modes, surface
from flexmb.fe.mesh_checks import Finding
from flexmb.fe.meshes.mesh_shapes import MeshLike, mesh_from
from flexmb.fe.meshes.scikit_fem_mesh import mesh_from_skfem
from flexmb.fe.model_checks import (
    Survey,
    check_mode_count,
    check_releases,
    mass_sentence,
    model_findings,
    nominal_mass,
    point_mass,
)
from flexmb.fe.multifrontal import blas_threads
from flexmb.fe.recovery import with_recovery
from flexmb.fe.reduction.eigenmodes import SymmetryPlane, make_symmetry_plane
from flexmb.fe.reduction.geometric_stiffening import require_stresses, with_geometric_stiffening
from flexmb.fe.reduction.membrane_stiffness import with_membrane_stiffness
from flexmb.fe.reduction.methods import (
    check_options,
    coordinates_text,
    file_provenance,
    model_provenance,
    reduce_model,
)
from flexmb.fe.reduction.missing_response import (
    inertia_response,
    omitted_responses,
    with_load_responses,
)
from flexmb.fe.reduction.reduced_basis import (
    ReducedBasis,
    ReducedModes,
    integrals,
    mode_infos,
    orthonormalise,
    rigid_basis,
)
from flexmb.fe.reduction.user_modes import read_user_modes
from flexmb.fe.scikit_fem import has_stress, model_from_basis, refuse_matrices, refuse_mesh_options
from flexmb.fe.sections.section_tables import MaterialLike, resolve, sections_from
from flexmb.fe.stress import stress_option
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.mesh_options import PointLoad
from flexmb.flexbody.options import require_tables
from flexmb.flexbody.parts import Interface
from flexmb.flexbody.planar_body import PLANES, check_shares, flatten_body
from flexmb.flexbody.static_response import load_nodes
from flexmb.progress import Progress, silent
from flexmb.units import unit_system

Words = Mapping[str, Mapping[str, Any]]


@blas_threads()
def reduce(
    mesh: MeshLike | SkfemMesh | CellBasis,
    *,
    units: str = "SI",
    material: MaterialLike | None = None,
    interfaces: Mapping[str, InterfaceLike] | None = None,
    modes: Any = None,
    damping: Any = None,
    name: str | None = None,
    sections: Mapping[str, Any] | None = None,
    ties: Words | None = None,
    masses: Words | None = None,
    springs: Words | None = None,
    loads: Words | None = None,
    reduction: str = "craig-bampton",
    mass_matrix: str = "consistent",
    plane: str | None = None,
    stress: bool | str = True,
    geometric_stiffening: str = "none",
    residual: str | Callable[[FlexBody], str] = "none",
    refine: int = 0,
    load_points: Sequence[int | Sequence[float]] = (),
    stiffness: Any = None,
    mass: Any = None,
    rigid: bool = False,
    inspect: Callable[..., None] | None = None,
    progress: Progress = silent,
) -> FlexBody:
    """Reduce a mesh to a flexible body.

    Parameters
    ----------
    mesh : path, mapping, Mesh, skfem.Mesh or skfem.CellBasis
        A file, or the table of a simple shape, ``{"type": "box", "size": [1, 0.1, 0.1]}``. The body
        consists of its volume elements and of the surfaces and lines to which ``sections`` gives a
        shell or beam section. Or a basis of scikit-fem, in SI, with its own ``stiffness`` and
        ``mass``.
    units : str
        Unit system of the mesh's coordinates; everything else is in SI.
    material : str, Material or mapping
        A name in the library, or E [Pa], nu [-], density [kg/m^3].
    interfaces : mapping of str to str or mapping, optional
        A mesh group or a table by name, see :func:`flexmb.fe.make_interfaces`. Without
        interfaces the modes are those of the free body.
    modes : int, mapping, array or path, optional
        Number of fixed-interface modes, 20 by default; the body has 6*interfaces + modes - 6
        coordinates (``modes`` without interfaces). Or ``{"frequency": f}`` [Hz], or
        ``{"effective_mass": share}``. User modes as an array or an .npz file, displacements in
        the mesh's unit of length.
    damping : float, str or mapping
        Damping ratio of every mode with the body in the joints of a scene, 0 to 1, ``"adams"`` or a
        table of :class:`flexmb.flexbody.damping.DampingOptions`; for scenes that set no damping.
    name : str, optional
        Name of the body; the file's by default.
    sections : mapping of str to section or mapping, optional
        Section [m] by mesh group, or under ``"all"``.
    ties : mapping of str to mapping, optional
        ``{name: {type: "rbe2" or "rbe3", reference: node or group of one, nodes: group}}``.
    masses, springs, mass_matrix
        As for :func:`flexmb.fe.assemble`.
    loads : mapping of str to mapping, optional
        Load patterns whose static response the modes shall contain exactly, see
        :func:`flexmb.fe.make_loads`.
    reduction : str
        ``"craig-bampton"``, ``"free-interface"``, ``"guyan"`` or ``"user"``.
    plane : str, optional
        ``"xy"``, ``"yz"`` or ``"zx"`` of the mesh's frame, for a planar scene: only modes that are
        symmetric about that plane (through the centre of mass) are kept and counted by ``modes``;
        the body has 3*interfaces + modes - 3 coordinates.
    stress : bool or str
        Stress per mode for results: ``"surface"`` (or True) at the skin, ``"all"`` also at nodes
        inside solids, ``"none"`` (or False) for a smaller file.
    geometric_stiffening : str
        ``"full"``: internal forces stiffen or soften the body, and its ends approach each other
        when it bends. Needs an interface; takes six static solutions per interface, and six more.
    residual : str or callable
        ``"inertia"`` adds up to twelve residual vectors, the static responses to the body's own
        inertia loads: deformation and stress under acceleration and spin are then exact in the
        static limit. ``"none"`` by default. Or a function that takes the body without residual
        vectors and returns one of these words.
    refine : int
        How many times the mesh is refined first; each time all elements are halved in every
        direction.
    load_points : sequence of int or (3,) float
        Mesh nodes besides the interfaces at which a scene applies loads, or positions [m] near
        them. The body then stores which part of the static response there its modes lack, and a
        run reports it; with geometric stiffening also what forces there do to its stiffness, and
        how the nodes move to second order.
    stiffness, mass : (N, N) sparse, optional
        With a basis: matrices of the free body over its degrees of freedom; ``material`` is then
        used only for stress and geometric stiffening.
    rigid : bool
        No modes: only mass, centre of mass, inertia, interfaces, nodes and surface; nothing is
        solved.
    inspect : callable, optional
        Called with the intermediate results (FEMatrices, reduced basis, its modes, the body, the
        mirror of a planar reduction or None), for example to assess them by ``quality_report``.
    progress : Progress
        Called with the phases read, assemble, factor, modes, integrals, recovery.

    Raises
    ------
    MeshError, MaterialError, ReductionError
        Says what is wrong, where, and which names are allowed; with a plane also by how much body
        or mesh are not symmetric about it.
    """
    word = "none" if callable(residual) else residual
    requested, ratios = check_options(reduction, modes, damping, word, geometric_stiffening)
    where, stiffens = stress_option(stress), geometric_stiffening == "full"
    scale = unit_system(units).factor(L=1)
    connections = {"ties": ties, "masses": masses, "springs": springs}
    tables = {"sections": sections, "interfaces": interfaces, "loads": loads}
    require_tables(MeshError, tables | connections)
    collector = ProblemCollector()
    progress("read", 0.0)
    if isinstance(mesh, CellBasis):
        refuse_mesh_options(units=units, sections=sections, **connections)
        resolved = None if material is None else resolve(material)
        fe = model_from_basis(mesh, stiffness, mass, resolved)
        ends = collector(make_interfaces, fe, interfaces or {}) or ()
        collector.raise_errors()
        findings = model_findings(fe, ends, scale)
        where = where if has_stress(fe) else "none"
    else:
        if stiffness is not None or mass is not None:
            refuse_matrices(stiffness=stiffness, mass=mass)
        if material is None:
            raise MaterialError.from_problems([Problem("material", "is missing")])
        model, ends, findings = prepare_model(
            collector, mesh, scale, material, sections, interfaces or {}, loads or {}, refine,
            **connections,
        )  # fmt: skip
        collector.raise_errors()
        assert model is not None
        fe = assemble_model(model, mass_matrix, progress)
        check_releases(fe, [part.nodes for part in ends])
        if sentence := mass_sentence(fe, point_mass(masses)):
            findings.append(Finding("warning", sentence))
    if stiffens:
        require_stresses(fe, ends, material is not None)
    progress("read", 1.0)
    for finding in findings:
        if finding.level == "warning":
            warnings.warn(finding.sentence, FlexmbWarning, stacklevel=2)
    mirror = None if plane is None else make_symmetry_plane(fe, plane)
    patterns = make_loads(fe, loads or {})
    if reduction == "user":
        requested = read_user_modes(requested, scale)
    if rigid:
        reduced = rigid_basis(fe, ends, patterns)
    else:
        reduced = reduce_model(
            fe, ends, reduction, requested, progress=progress, mirror=mirror, loads=patterns,
            residual=word,
        )  # fmt: skip
    called = name or Path(fe.mesh.source).stem
    elastic = orthonormalise(fe, reduced)
    body = make_body(called, fe, reduced, elastic, progress)
    if callable(residual):
        choice = residual(body)
        check_options(reduction, modes, damping, choice, geometric_stiffening)
        if choice == "inertia" and reduced.with_inertia is not None:
            word, reduced = "inertia", reduced.with_inertia()
            elastic = orthonormalise(fe, reduced)
            body = make_body(called, fe, reduced, elastic, progress)
    omitted = omitted_responses(fe, reduced, elastic)
    body = with_recovery(body, fe, elastic.Phi, where, progress, omitted)
    if not rigid:
        body = with_load_responses(body, fe, reduced, elastic, load_points, mirror, progress)
    if stiffens:
        loaded = [] if rigid else load_nodes(body.nodes, load_points)
        body = with_geometric_stiffening(
            body, fe, elastic.Phi, ends, patterns, loaded, progress, mirror, reduction != "user"
        )
    if mirror is None:
        body = with_membrane_stiffness(body, fe, reduced, elastic, progress)
    else:
        body = _in_plane(body, fe, mirror, elastic)
    if inspect is not None:
        inspect(fe, reduced, elastic, body, mirror)
    options: dict[str, Any] = {"units": units, "damping": damping, **connections, "loads": loads}
    options |= {"modes": 20 if modes is None else modes, "mass_matrix": mass_matrix}
    options |= {"reduction": reduction, "plane": plane, "stress": where}
    options |= {"geometric_stiffening": geometric_stiffening, "residual": word}
    options |= {key: value for key, value in (("rigid", rigid), ("refine", refine)) if value}
    made = sections_from(sections)
    source = {**body.provenance, **model_provenance(fe, options, interfaces or {}, made, findings)}
    if isinstance(mesh, str | os.PathLike | Mapping):
        source |= file_provenance(mesh, options, material, interfaces, name, made)
    return replace(body, provenance=source, damping=ratios)


def prepare_model(
    collector: ProblemCollector,
    mesh: MeshLike | SkfemMesh,
    scale: float,
    material: MaterialLike | None,
    sections: Mapping[str, Any] | None,
    interfaces: Mapping[str, InterfaceLike],
    loads: Words,
    refine: int = 0,
    **connections: Words | None,
) -> tuple[MeshModel | None, tuple[ModelInterface, ...], list[Finding]]:
    """The model before assembly, its interfaces, and findings; errors go to the collector."""
    if mesh is None:
        raise MeshError.from_problems([Problem("mesh", "is missing")])
    if not isinstance(refine, int) or refine < 0:
        what = f"must be a whole number from 0 on, given {refine!r}"
        raise MeshError.from_problems([Problem("refine", what)])
    plain = collector(mesh_from_skfem, mesh) if isinstance(mesh, SkfemMesh) else mesh
    read = None if plain is None else collector(mesh_from, plain, "mesh", refine)
    made = collector(sections_from, sections)
    resolved = None if material is None else collector(resolve, material)
    if read is None:
        return None, (), []
    read = read.scaled(scale)
    model = make_model(read, resolved, made, collector, **connections)
    if model is None:
        for name, words in interfaces.items():
            group = words if isinstance(words, str) else words.get("group")
            if group is not None:
                collector(read.group_nodes, group, f"interfaces.{name}")
    ends = () if model is None else collector(make_interfaces, model, interfaces) or ()
    for name, words in loads.items():
        options = collector(load_options, name, words)
        if isinstance(options, PointLoad):
            if model is not None:
                collector(select_interface, model, f"loads.{name}", options)
        elif hasattr(options, "group"):
            collector(read.group_nodes, options.group, f"loads.{name}.group")
    findings = [] if model is None else model_findings(model, ends, scale)
    errors = [Problem(read.source, f.sentence) for f in findings if f.level == "error"]
    if errors:
        collector.errors.append(MeshError.from_problems(errors))
    return model, ends, findings


def _in_plane(
    body: FlexBody, fe: FEMatrices, mirror: SymmetryPlane, elastic: ReducedModes
) -> FlexBody:
    """The planar body: flattened after a check that its modes hardly leave the plane."""
    shares, normal = mirror.shares(fe, elastic.Phi), PLANES[mirror.plane]
    check_shares(body.name, shares, elastic.frequencies, normal)
    return flatten_body(body, normal, float(shares.max(initial=0.0)))


def survey(
    mesh: MeshLike | SkfemMesh,
    *,
    units: str = "SI",
    material: MaterialLike | None = None,
    sections: Mapping[str, Any] | None = None,
    interfaces: Mapping[str, InterfaceLike] | None = None,
    ties: Words | None = None,
    masses: Words | None = None,
    springs: Words | None = None,
    loads: Words | None = None,
    modes: Any = 20,
    reduction: str = "craig-bampton",
    plane: str | None = None,
    residual: str = "none",
    rigid: bool = False,
    refine: int = 0,
    **others: Any,
) -> Survey:
    """Check the input of a reduction without assembly: all problems, and what the body will have.

    The parameters are those of :func:`reduce`.
    """
    collector, scale = ProblemCollector(), unit_system(units).factor(L=1)
    connections = {"ties": ties, "masses": masses, "springs": springs}
    model, ends, findings = prepare_model(
        collector, mesh, scale, material, sections, interfaces or {}, loads or {}, refine,
        **connections,
    )  # fmt: skip
    if model is not None and not rigid:
        collector(check_mode_count, model, ends, modes, reduction)
    if model is None or collector.errors:
        return Survey(collector.problems)
    counts: dict[str, int] = {}
    for block in model.blocks:
        counts[block.kind] = counts.get(block.kind, 0) + len(block.nodes)
        if block.family.warning:
            what = f'{len(block.nodes)} elements of kind "{block.kind}": {block.family.warning}'
            findings.append(Finding("warning", what))
    mass = 0.0
    if model.material is not None:
        mass = nominal_mass(model.blocks, model.mesh.points) + point_mass(masses)
    return Survey(
        [],
        findings,
        counts,
        model.numbering.n,
        "none: rigid"
        if rigid
        else coordinates_text(
            6 if plane is None else 3, len(ends), modes, reduction, loads or {}, residual
        ),
        mass,
        {part.name: part.position for part in ends},
        model.mesh.points,
        dict(model.mesh.node_sets),
    )


def make_body(
    name: str,
    fe: FEMatrices,
    reduced: ReducedBasis,
    elastic: ReducedModes,
    progress: Progress = silent,
) -> FlexBody:
    """Put the parts of a flexible body together.

    Parameters
    ----------
    name : str
        Name of the body.
    fe, reduced, elastic
        The model, its reduced basis and the modes made of it.
    progress : Progress
        Called with the phases ``"integrals"`` and ``"recovery"``.
    """
    progress("integrals", 0.0)
    ties = reduced.interfaces
    inertia = integrals(fe, elastic.Phi)
    progress("integrals", 1.0)
    motion = reduced.motion @ elastic.Z
    rows = [k for k, tie in enumerate(ties) if isinstance(tie, RigidInterface)]
    rigid = tuple(ties[k] for k in rows)
    nodes = node_modes(fe, elastic.Phi, rigid, motion[rows, 3:], progress)
    return FlexBody(
        name,
        **vars(inertia),
        K=np.diag(elastic.omega2),
        interfaces=tuple(
            Interface(tie.name, tie.position, q[:3], q[3:])
            for tie, q in zip(ties, motion, strict=True)
        ),
        modes=mode_infos(fe, reduced, elastic, inertia.Mab),
        surface=surface(fe, nodes) if fe.blocks else None,
        nodes=nodes,
        loads=tuple(reduce_load(fe, elastic.Phi, load) for load in reduced.loads),
        inertia_response=inertia_response(fe, reduced, elastic),
    )
