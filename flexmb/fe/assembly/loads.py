"""Loads on a model: pressure, traction, line load, force on nodes, weight.

:func:`make_loads` returns :class:`LoadPattern`, work-equivalent nodal loads with their resultant.
Facets are integrated with their own shape functions, int N^T t dA; the solid element at a facet
defines the outward direction. Forces on groups are distributed as those of a weighted interface;
loads on dependent nodes of a tie are transferred to the independent ones. Source: Zienkiewicz,
Taylor, The Finite Element Method, vol. 1 (consistent loads).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import FlexmbWarning, MeshError, Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.connections import spans_rotation
from flexmb.fe.assembly.interfaces import make_interface, select_interface, weight_samples
from flexmb.fe.elements.beam_elements import BeamFields
from flexmb.fe.elements.element_blocks import outer_faces
from flexmb.fe.elements.shell_fields import edge_bows, opposed_edges
from flexmb.fe.meshes.mesh import FACETS, dimension, facet_rule
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.mesh_options import LOADS, GravityLoad, PointLoad
from flexmb.flexbody.options import kind_of, read_options
from flexmb.flexbody.parts import LoadPoint, LoadVector

# number of corners of facets by their number of nodes
_CORNERS = {2: 2, 3: 3, 4: 4, 6: 3, 8: 4, 9: 4}


def pressure_load(fe: FEMatrices, where: str, group: str, pressure: float) -> FloatArray:
    """(n_all,) loads of a pressure [Pa]: into the solid of a facet, along the normal of a shell.

    Raises
    ------
    MeshError
        The group has no facets, or some that neither bound a solid of the body nor are shells.
    """
    f, skins = np.zeros(fe.numbering.n_all), []
    outside = {face.shape[1]: face for face in outer_faces(fe.blocks, fe.mesh.points)}
    missing = 0
    for kind, cells in _cells(fe, where, group, 2):
        shells = [b.nodes for b in fe.blocks if b.family.dimension == 2 and b.kind == kind]
        is_shell = (
            _match_facets(cells, np.concatenate(shells))[0]
            if shells
            else np.zeros(len(cells), bool)
        )
        rest = cells[~is_shell]
        there, row = _match_facets(rest, outside.get(cells.shape[1], rest[:0]))
        missing += int((~there).sum())
        _add_pressure(fe, f, kind, cells[is_shell], pressure)
        skins.append(cells[is_shell])
        if there.any():
            _add_pressure(fe, f, kind, outside[cells.shape[1]][row[there]], -pressure)
    if missing:
        what = f'{missing} facets of the group "{group}" neither bound a solid of the body nor are '
        what += "shells: there is nothing to push on"
        raise MeshError.from_problems([Problem(where, what)])
    if len(edges := opposed_edges(skins)):
        what = f'{where}: the normals of shells of the group "{group}" point to opposite sides at '
        what += f"{len(edges)} edges, the first between the nodes {edges[0, 0]} and {edges[0, 1]}: "
        what += "the pressure pushes both ways; number the nodes of all elements in one sense"
        warnings.warn(what, FlexmbWarning, stacklevel=2)
    return f


def condensed_load(fe: FEMatrices, f: FloatArray) -> FloatArray:
    """(n,) loads on the independent degrees of freedom from those on all, (n_all,)."""
    n = fe.numbering.n
    return f if fe.follow is None else f[:n] + fe.follow.T @ f[n:]


def _uniform(fe: FEMatrices, where: str, group: str, dim: int, load: FloatArray) -> FloatArray:
    f = np.zeros(fe.numbering.n_all)
    for kind, facets in _cells(fe, where, group, dim):
        if not np.isin(facets, fe.numbering.nodes).all():
            what = f'the group "{group}" has nodes that belong to no element of the body'
            raise MeshError.from_problems([Problem(where, what)])
        cells = _load_beams(fe, f, facets, load) if kind == "line" else facets
        rule = facet_rule(kind, fe.mesh.points[cells])
        shares = np.einsum("fq,kq->fk", rule.size, rule.N)
        np.add.at(f, fe.numbering.table[cells, :3], shares[:, :, None] * load)
        if kind == "line":  # rotations bow the edges of shells
            shells = [block.nodes for block in fe.blocks if block.family.dimension == 2]
            bow = 0.5 * rule.size @ np.prod(rule.N, axis=0)
            B = edge_bows(fe.mesh.points, shells, cells)
            moments = bow[:, None, None] * (np.swapaxes(B, 1, 2) @ load)[:, None]
            numbers = fe.numbering.table[cells, 3:]
            there = (numbers >= 0).all(axis=(1, 2))
            np.add.at(f, numbers[there], (moments * np.array([[1.0], [-1.0]]))[there])
    return f


def _load_beams(fe: FEMatrices, f: FloatArray, cells: IntArray, load: FloatArray) -> IntArray:
    """Add a load per length [N/m] along the nodes of beams; return the lines that are not beams. It
    works on the displacement field of each beam, which depends on taper, shear and released ends.
    """
    rest = np.ones(len(cells), dtype=bool)
    for block in fe.blocks:
        if block.family.dimension != 1:
            continue
        there, row = _match_facets(cells, block.nodes)
        if not there.any():
            continue
        rest &= ~there
        x = fe.mesh.points[block.nodes]
        fields = BeamFields(x, block.section)
        arms = -np.matmul(fields.arms, fields.axes)[:, :, None]  # from the centroids to the nodes
        arms = arms[:, 0] + fields.t[:, None] * (arms[:, 1] - arms[:, 0])
        y, z = arms[..., 1:2], arms[..., 2:]
        u = fields.u - y * fields.B - z * fields.C
        stretch = np.linalg.norm(x[:, 1] - x[:, 0], axis=1) / fields.length
        weight = np.broadcast_to(stretch[:, None], fields.dx.shape)
        parts = (u, fields.V - z * fields.phi, fields.W + y * fields.phi)
        work = np.stack([fields.integral(weight, part) for part in parts], axis=1)
        work = np.einsum("a,eab,ebi->ei", load, fields.axes, work @ fields.turn)
        np.add.at(f, fe.numbering.of(block.nodes[row[there]], 6), work[row[there]])
    return cells[rest]


def _add_pressure(
    fe: FEMatrices, f: FloatArray, kind: str, cells: IntArray, pressure: float
) -> None:
    """Add the loads of a pressure along the normal that the order of the nodes gives."""
    rule = facet_rule(kind, fe.mesh.points[cells])
    loads = np.einsum("fq,kq,fqc->fkc", pressure * rule.size, rule.N, rule.normal)
    np.add.at(f, fe.numbering.table[cells, :3], loads)


def _cells(fe: FEMatrices, where: str, group: str, dim: int) -> list[tuple[str, IntArray]]:
    rows = fe.mesh.group_elements(group, where)
    cells = [
        (kind, fe.mesh.blocks[kind][row])
        for kind, row in rows.items()
        if dimension(kind) == dim and kind in FACETS and len(row)
    ]
    if not cells:
        what = "surface elements" if dim == 2 else "line elements"
        problem = Problem(where, f'the group "{group}" has no {what} to carry the load')
        raise MeshError.from_problems([problem])
    return cells


def _match_facets(cells: IntArray, among: IntArray) -> tuple[np.ndarray, IntArray]:
    """Which facets occur in another list, whatever the order of their corners, and in which row."""
    corners = _CORNERS[cells.shape[1]]
    one, other = (np.sort(part[:, :corners], axis=1) for part in (cells, among))
    _, number = np.unique(np.concatenate([one, other]), axis=0, return_inverse=True)
    number = np.ravel(number)
    row = np.full(len(one) + len(other), -1)
    row[number[len(one) :]] = np.arange(len(other))
    match = row[number[: len(one)]]
    return match >= 0, match


# a resultant below this fraction of the sum of the magnitudes of its parts is round-off
_ZERO_RESULTANT = 1e-13


@dataclass(frozen=True, eq=False)
class LoadPattern:
    """Nodal loads on a body.

    Parameters
    ----------
    name : str
        Name of the load.
    f : (n,) float
        Loads over the degrees of freedom [N, N m].
    force, moment : (3,) float
        Resultant, and its moment about the origin of the body frame [N, N m].
    residual : bool
        Whether the reduced basis is to contain its static response.
    """

    name: str
    f: FloatArray
    force: FloatArray
    moment: FloatArray
    residual: bool = True


def make_loads(
    fe: FEMatrices, options_by_name: Mapping[str, Mapping[str, Any]]
) -> tuple[LoadPattern, ...]:
    """Nodal loads from what is said of each.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    options_by_name : mapping of str to mapping
        By name, in SI and body axes: ``{type = "pressure", group, pressure}`` [Pa], pushing on
        solids and along the normal of shells; ``{type = "traction", group, traction}`` [Pa] (3,);
        ``{type = "line", group, force}`` [N/m] (3,); ``{type = "force", force, moment}`` [N, N m]
        (3,) each on nodes chosen as for an interface; ``{type = "gravity", acceleration}``
        [m/s^2] (3,). ``residual`` says whether the basis holds the static response: true by
        default, false for gravity, which does not deform a free body.

    Raises
    ------
    ReductionError
        All unknown words and types, missing values, groups without facets.
    """
    patterns, problems = [], []
    for name, words in options_by_name.items():
        try:
            patterns.append(_make_load(fe, name, words))
        except (MeshError, ReductionError) as error:
            problems += error.problems
    if problems:
        raise ReductionError.from_problems(problems)
    return tuple(patterns)


def _make_load(fe: FEMatrices, name: str, words: Mapping[str, Any]) -> LoadPattern:
    where = f"loads.{name}"
    options = load_options(name, words)
    f = condensed_load(fe, load_vector(fe, where, options))
    R = fe.rigid
    total = R.T @ f
    parts = (np.abs(R.T) @ np.abs(f)).reshape(2, 3).max(axis=1)
    total[np.abs(total) <= _ZERO_RESULTANT * np.repeat(parts, 3)] = 0.0
    force = total[:3]
    moment = total[3:] + np.cross(fe.center, force)
    return LoadPattern(name, f, force, moment, options.residual)


def reduce_load(fe: FEMatrices, Phi: FloatArray, load: LoadPattern) -> LoadVector:
    """A load on modes (n, m), and the points at which it acts in a run.

    All nodal forces of one component and one sign are replaced by a force at the mean position of
    their nodes, weighted by the forces: it has the same resultant, the same moment about any point,
    and the same work in any first-order motion. Nodal moments are treated likewise, with the mean
    rotation.
    """
    everywhere, points, m = fe.expand(Phi), [], Phi.shape[1]
    for c, numbers in enumerate(fe.numbering.table.T):
        nodes = np.flatnonzero((numbers >= 0) & (numbers < len(load.f)))
        values = load.f[numbers[nodes]]
        for sign in (1.0, -1.0):
            weights = np.maximum(sign * values, 0.0)
            total = float(weights.sum())
            if total <= _ZERO_RESULTANT * np.abs(load.f).sum():
                continue
            there, axis, wrench = nodes[weights > 0.0], 3 * (c // 3), np.zeros(6)
            mean = weights[weights > 0.0] / total
            wrench[c] = sign * total
            motion = np.zeros((2, 3, m))
            rows = fe.numbering.table[there, axis : axis + 3]
            motion[c // 3] = np.einsum("k,kdm->dm", mean, everywhere[rows])
            name = f"{'force' if c < 3 else 'moment'} {'+' if sign > 0 else '-'}{'xyz'[c % 3]}"
            position = mean @ fe.mesh.points[there]
            points.append(LoadPoint(name, position, *motion, wrench=wrench))
    return LoadVector(load.name, load.force, load.moment, Phi.T @ load.f, tuple(points))


def load_vector(fe: FEMatrices, where: str, options: Any) -> FloatArray:
    """(n_all,) the nodal loads for the options of a load."""
    return _LOADS[options.type](fe, where, options)


def load_options(name: str, words: Mapping[str, Any]) -> Any:
    """The options of a load.

    Raises
    ------
    ReductionError
        Unknown type or words, missing values, values that cannot be.
    """
    where = f"loads.{name}"
    kind = kind_of("type", tuple(LOADS), words, where, ReductionError)
    return read_options(LOADS[kind], words, where, ReductionError)


def _gravity(fe: FEMatrices, where: str, options: GravityLoad) -> FloatArray:
    return fe.load_per_mass(np.column_stack([np.zeros((3, 3)), options.acceleration]))


def _force(fe: FEMatrices, where: str, options: PointLoad) -> FloatArray:
    force, moment = (np.array(v or (0.0,) * 3, float) for v in (options.force, options.moment))
    selection = select_interface(fe, where, options)
    nodes, f = selection.nodes, np.zeros(fe.numbering.n_all)
    rotating = np.isin(nodes, fe.numbering.rotating).any()
    if moment.any() or rotating or spans_rotation(fe.mesh.points[nodes]):
        dofs, values = make_interface(fe, "", options, where).loads()
        np.add.at(f, dofs, values @ np.concatenate([force, moment]))
    else:  # nodes that carry no moment share the force
        samples, _ = weight_samples(fe, selection)
        share = samples.T @ (samples @ np.ones(len(nodes)))
        np.add.at(f, fe.numbering.table[nodes, :3], np.outer(share / share.sum(), force))
    return f


_LOADS: dict[str, Callable[[FEMatrices, str, Any], FloatArray]] = {
    "pressure": lambda fe, where, one: pressure_load(fe, where, one.group, float(one.pressure)),
    "traction": lambda fe, where, one: _uniform(fe, where, one.group, 2, np.array(one.traction)),
    "line": lambda fe, where, one: _uniform(fe, where, one.group, 1, np.array(one.force)),
    "force": _force,
    "gravity": _gravity,
}
