"""From a mesh to a flexible body in one call.

In: a mesh with its unit system, a material, named interfaces, a number of modes. Out: a
:class:`FlexBody` in SI. Each step (read, assemble, reduce, orthonormalise, integrals, recovery) is
a function of its own in this package, for whoever needs what lies between.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import FlexmbWarning, Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices, assemble
from flexmb.fe.checks.hinges import require_hinges_held
from flexmb.fe.checks.model import mode_infos, orphans, require_one_part, suspicions
from flexmb.fe.interfaces.rigid import RigidInterface, make_interfaces
from flexmb.fe.key import mesh_hash, reduction_key
from flexmb.fe.material import MaterialLike, resolve
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.reader import read_mesh
from flexmb.fe.recovery.nodes import node_modes, surface
from flexmb.fe.reduction.craig_bampton import CraigBampton, craig_bampton
from flexmb.fe.reduction.free_modes import free_modes
from flexmb.fe.reduction.integrals import integrals
from flexmb.fe.reduction.orthonormal import ReducedModes, orthonormalise
from flexmb.fe.reduction.planar import Mirror, make_mirror
from flexmb.fe.sections.read import section_from
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.parts import Interface
from flexmb.flexbody.planar import check_shares, flattened
from flexmb.flexbody.planes import PLANES
from flexmb.progress import Progress, silent
from flexmb.units import unit_system

__all__ = ["reduce"]


def reduce(
    mesh: str | os.PathLike[str] | Mesh,
    *,
    units: str = "SI",
    material: MaterialLike,
    interfaces: Mapping[str, str] | None = None,
    modes: int = 20,
    damping: float = 0.0,
    name: str | None = None,
    sections: Mapping[str, Any] | None = None,
    ties: Mapping[str, Mapping[str, Any]] | None = None,
    masses: Mapping[str, Mapping[str, Any]] | None = None,
    springs: Mapping[str, Mapping[str, Any]] | None = None,
    mass_matrix: str = "consistent",
    plane: str | None = None,
    progress: Progress = silent,
) -> FlexBody:
    """Reduce a mesh to a flexible body.

    Parameters
    ----------
    mesh : path or Mesh
        Volume elements, and the surfaces and lines that ``sections`` says are shells and beams.
    units : str
        Unit system of the mesh's coordinates; everything else is in SI.
    material : str, Material or mapping
        A name in the library, or E [Pa], nu [-], density [kg/m^3].
    interfaces : mapping of str to str, optional
        Mesh group by interface name. Without any, free modes are taken.
    modes : int
        Number of fixed-interface modes; the body has 6*interfaces + modes - 6 coordinates
        (``modes`` without interfaces).
    damping : float
        Damping ratio of every mode, 0 to 1. None by default.
    name : str, optional
        Name of the body; the file's by default.
    sections : mapping of str to section or mapping, optional
        Section [m] by mesh group, or under ``"all"``.
    ties : mapping of str to mapping, optional
        ``{name: {type: "rbe2" or "rbe3", reference: node or group of one, nodes: group}}``.
    masses : mapping of str to mapping, optional
        ``{name: {at: node or group, mass: kg, inertia: [Jxx, Jyy, Jzz] or 3 x 3 about its own
        centre [kg m^2], offset: arm from the node [m]}}``.
    springs : mapping of str to mapping, optional
        ``{name: {between: two nodes or groups of one, stiffness: N/m, or six [N/m, N m/rad] with
        axes: two directions}}``.
    mass_matrix : str
        ``"consistent"``, or ``"hrz"`` for mass lumped at the nodes.
    plane : str, optional
        ``"xy"``, ``"yz"`` or ``"zx"`` of the mesh's frame, for a planar scene: only modes that are
        symmetric about that plane (through the centre of mass) are kept and counted by ``modes``;
        the body has 3*interfaces + modes - 3 coordinates.
    progress : Progress
        Told the phases read, assemble, factor, modes, integrals, recovery.

    Raises
    ------
    MeshError, MaterialError, ReductionError
        What is wrong, where, and which names would have been right; with a plane also that body
        or mesh are not symmetric about it, and by how much.
    """
    _check_options(modes, damping)
    scale = unit_system(units).factor(L=1)
    matter = resolve(material)
    chosen = {key: section_from(s, f"sections.{key}") for key, s in (sections or {}).items()}
    progress("read", 0.0)
    given = mesh if isinstance(mesh, Mesh) else read_mesh(mesh)
    progress("read", 1.0)
    extras: dict[str, Any] = {"ties": ties, "masses": masses, "springs": springs}
    extras = {key: dict(value) for key, value in extras.items() if value}
    if mass_matrix != "consistent":
        extras["mass_matrix"] = mass_matrix
    fe = assemble(given.scaled(scale), matter, chosen, progress, **extras)
    ties = make_interfaces(fe, interfaces or {})
    require_one_part(fe, ties)
    require_hinges_held(fe, [tie.nodes for tie in ties])
    found = suspicions(fe)
    for sentence in found:
        warnings.warn(sentence, FlexmbWarning, stacklevel=2)
    mirror = None if plane is None else make_mirror(fe, plane)
    reduced = _basis(fe, ties, modes, mirror, progress)
    elastic = orthonormalise(fe, reduced)
    body = make_body(name or Path(given.source).stem, fe, reduced, elastic, damping, progress)
    options: dict[str, Any] = {"units": units, "modes": modes, "damping": damping, **extras}
    if mirror is not None:
        body = _in_plane(body, fe, mirror, elastic)
        options["plane"] = plane
    told = {**body.provenance, **_provenance(fe, options, interfaces or {}, chosen, found)}
    if not isinstance(mesh, Mesh):
        told |= _file_provenance(mesh, options, material, interfaces, name, chosen)
    return replace(body, provenance=told)


def _basis(
    fe: FEMatrices,
    ties: tuple[RigidInterface, ...],
    modes: int,
    mirror: Mirror | None,
    progress: Progress,
) -> CraigBampton:
    if ties:
        return craig_bampton(fe, ties, modes, progress, mirror)
    return free_modes(fe, modes, progress, mirror)


def _in_plane(body: FlexBody, fe: FEMatrices, mirror: Mirror, elastic: ReducedModes) -> FlexBody:
    """The body without what rounding and mesh leave of motion out of the plane, if it is little."""
    shares, normal = mirror.shares(fe, elastic.Phi), PLANES[mirror.plane]
    check_shares(body.name, shares, elastic.frequencies, normal)
    return flattened(body, normal, float(shares.max(initial=0.0)))


def make_body(
    name: str,
    fe: FEMatrices,
    reduced: CraigBampton,
    elastic: ReducedModes,
    damping: float = 0.0,
    progress: Progress = silent,
) -> FlexBody:
    """Put the parts of a flexible body together.

    Parameters
    ----------
    name : str
        Name of the body.
    fe, reduced, elastic
        The model, its reduced basis and the modes made of it.
    damping : float
        Damping ratio of every mode.
    progress : Progress
        Told the phases ``"integrals"`` and ``"recovery"``.
    """
    progress("integrals", 0.0)
    ties = reduced.interfaces
    inertia = integrals(fe, elastic.Phi)
    progress("integrals", 1.0)
    motion = np.zeros((len(ties), 6, elastic.Z.shape[1]))
    moving = (len(ties), len(reduced.directions), elastic.Z.shape[1])
    motion[:, reduced.directions] = elastic.Z[: reduced.constraints].reshape(moving)
    nodes = node_modes(fe, elastic.Phi, ties, motion[:, 3:], progress)
    return FlexBody(
        name,
        **vars(inertia),
        K=np.diag(elastic.omega2),
        D=np.diag(2 * damping * np.sqrt(elastic.omega2)),
        interfaces=tuple(
            Interface(tie.name, tie.position, q[:3], q[3:])
            for tie, q in zip(ties, motion, strict=True)
        ),
        modes=mode_infos(fe, reduced, elastic, inertia.Mab),
        surface=surface(fe, nodes),
        nodes=nodes,
    )


def _check_options(modes: int, damping: float) -> None:
    problems = []
    if isinstance(modes, bool) or not isinstance(modes, int | np.integer) or modes < 0:
        problems.append(Problem("modes", f"must be a whole number >= 0, given {modes!r}"))
    if isinstance(damping, bool) or not isinstance(damping, int | float) or not 0 <= damping < 1:
        what = f"must be a damping ratio from 0 to below 1, given {damping!r}"
        problems.append(Problem("damping", what))
    if problems:
        raise ReductionError.from_problems(problems)


def _provenance(
    fe: FEMatrices,
    options: Mapping[str, Any],
    interfaces: Mapping[str, str],
    sections: Mapping[str, Any],
    found: list[str],
) -> dict[str, str]:
    packages = ("numpy", "scipy", "scikit-fem", "meshio")
    return {
        "mesh": fe.mesh.source,
        "material": json.dumps(asdict(fe.material)),
        "interfaces": json.dumps(dict(interfaces)),
        "sections": json.dumps({name: asdict(section) for name, section in sections.items()}),
        **{name: str(value) for name, value in options.items()},
        "degrees of freedom": str(fe.numbering.n),
        "nodes outside the body": str(orphans(fe)),
        "warnings": "\n".join(found),
        "versions": ", ".join(f"{package} {version(package)}" for package in packages),
    }


def _file_provenance(
    mesh: str | os.PathLike[str],
    options: Mapping[str, Any],
    material: MaterialLike,
    interfaces: Mapping[str, str] | None,
    name: str | None,
    sections: Mapping[str, Any],
) -> dict[str, str]:
    key = reduction_key(
        mesh, material=material, interfaces=interfaces, name=name, sections=sections, **options
    )
    return {"key": key, "mesh sha256": mesh_hash(mesh)}
