"""What the modes of a reduced body lack of the full model's static responses and modes.

With X static responses of the full model (to inertia loads, or to loads at nodes) and Φ the modes,
orthogonal in K, Y = X − Φ (Φᵀ K X)/ω² is the missing part of X. The strain energy of any
combination of loads is the sum of that of the modes and that of Y. Omitted modes are treated
likewise: what Φ contains of them is removed, and the rest is taken as a vibration by itself, driven
by loads and by the inertia of all other motion.

If the basis has constraint modes, the interfaces are held fixed and loads on them drive nothing.
User modes are judged on the free body, and loads at its interfaces are then among those whose
responses may be missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface
from flexmb.fe.assembly.loads import condensed_load
from flexmb.fe.reduction.eigenmodes import Modes, SymmetryPlane
from flexmb.fe.reduction.free_body import relieved_inverse
from flexmb.fe.reduction.inertia_relief import InertiaRelief, inertia_loads
from flexmb.fe.reduction.reduced_basis import ReducedBasis, ReducedModes
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.static_response import InertiaResponse, LoadResponse, OmittedModes, load_nodes
from flexmb.progress import Progress, silent

# energy below this share of the largest energy of a response is round-off
_ENERGY_ROUND_OFF = 1e-10
# a mode of which the basis leaves less than this share of its strain energy is in the basis
_COVERED_ENERGY = 0.01
# relative size (of 1/ω², or of a load after relief) below which a direction is round-off
_RANK_TOLERANCE = 1e-8


def inertia_response(
    fe: FEMatrices, basis: ReducedBasis, elastic: ReducedModes
) -> InertiaResponse | None:
    """Energies of the static responses to inertia loads, and of the parts that the modes lack."""
    X = basis.inertia
    if X is None:
        return None
    forms = missing_energy_forms(fe, X, (elastic.omega2, elastic.Phi))
    if basis.without is not None:
        forms += missing_energy_forms(fe, X, basis.without)[1:]
    return InertiaResponse(*forms)


def omitted_responses(
    fe: FEMatrices, basis: ReducedBasis, elastic: ReducedModes
) -> FloatArray | None:
    """(n, 12) missing parts of the static responses to inertia loads; None if none is missing."""
    X = basis.inertia
    if X is None:
        return None
    Y = _missing_part(fe, X, (elastic.omega2, elastic.Phi))
    full, lacks = (np.einsum("nr,nr->r", Z, fe.K @ Z) for Z in (X, Y))
    counts = lacks > _ENERGY_ROUND_OFF * full.max()
    return np.where(counts, Y, 0.0) if counts.any() else None


def missing_energy_forms(fe: FEMatrices, X: FloatArray, modes: Modes) -> tuple[FloatArray, ...]:
    """Quadratic forms (r, r) over responses X: strain energy, missing strain energy, missing
    motion.

    The motion is the kinetic form of the missing part without its rigid motion. The modes must be
    orthogonal to each other in K and of unit modal mass.
    """
    Y = _missing_part(fe, X, modes)
    moved = InertiaRelief(fe.M, fe.rigid).fields(Y)
    forms = (X.T @ (fe.K @ X), Y.T @ (fe.K @ Y), moved.T @ (fe.M @ moved))
    return tuple(0.5 * (form + form.T) for form in forms)


def _missing_part(fe: FEMatrices, X: FloatArray, modes: Modes) -> FloatArray:
    """The parts of fields X (n, r) that the modes do not contain: X − Φ (Φᵀ K X)/ω²."""
    omega2, Phi = modes
    return np.asarray(X - Phi @ ((Phi.T @ (fe.K @ X)) / omega2[:, None]))


def with_load_responses(
    body: FlexBody,
    fe: FEMatrices,
    basis: ReducedBasis,
    elastic: ReducedModes,
    points: Sequence[int | Sequence[float]],
    mirror: SymmetryPlane | None = None,
    progress: Progress = silent,
) -> FlexBody:
    """The body with its responses to loads at nodes, and with the modes that it omits.

    Parameters
    ----------
    body, fe, basis, elastic
        The body, its model, its basis and the modes made of it.
    points : sequence of int or (3,) float
        Nodes of the mesh, or positions [m] whose nearest nodes are meant.
    mirror : SymmetryPlane, optional
        Of a planar reduction.
    progress : Progress
        Called with the phases of a factorisation.
    """
    nodes = load_nodes(body.nodes, points)
    ends: tuple[ModelInterface, ...] = basis.interfaces
    free = not ends or basis.inertia is None
    loads = [node_loads(fe, node, ends) for node in nodes]
    if basis.inertia is None:  # user modes
        names = range(len(ends))
        nodes = [*nodes, *(-1 - k for k in names)]
        for part in ends:
            f = np.zeros((fe.numbering.n, 6))
            dofs, values = part.loads()
            f[dofs] = values
            loads.append(f)
    relief = InertiaRelief(fe.M, fe.rigid)
    rest = [load for load in basis.loads if not load.residual]
    if free:  # a load that only accelerates the body as a whole deforms nothing
        norm = np.linalg.norm
        rest = [x for x in rest if norm(relief.loads(x.f)) > _RANK_TOLERANCE * norm(x.f)]
    loads += [load.f[:, None] for load in rest]
    F = np.concatenate([np.zeros((fe.numbering.n, 0)), *loads], axis=1)
    if mirror is not None:
        F = 0.5 * (F + mirror.S.T @ F)
    response, modes, at_nodes = None, (elastic.omega2, elastic.Phi), slice(0, 6 * len(nodes))
    if free and (loads or basis.inertia is None):
        solve = relieved_inverse(fe, relief, progress)
        if basis.inertia is None:
            X = solve(inertia_loads(fe, mirror, rigid=False))
            body = replace(
                body, inertia_response=InertiaResponse(*missing_energy_forms(fe, X, modes))
            )
    elif loads:
        assert basis.fixed_response is not None
        solve = basis.fixed_response
    if loads:
        forms = missing_energy_forms(fe, solve(F), modes)
        if nodes:
            response = LoadResponse(np.array(nodes), *(form[at_nodes, at_nodes] for form in forms))
        body = _with_missing_shares(body, [load.name for load in rest], forms, at_nodes.stop)
    omitted = _omitted(fe, basis, elastic, F[:, at_nodes])
    return replace(body, load_response=response, omitted_modes=omitted)


def _with_missing_shares(
    body: FlexBody, names: list[str], forms: tuple[FloatArray, ...], first: int
) -> FlexBody:
    """The body; each load whose response need not be in the basis gets the share the modes lack."""
    full, lacks = (np.diag(form)[first:] for form in forms[:2])
    shares = dict(zip(names, lacks / np.where(full > 0.0, full, 1.0), strict=True))
    loads = (replace(load, missing_share=shares.get(load.name, 0.0)) for load in body.loads)
    return replace(body, loads=tuple(loads))


def node_loads(fe: FEMatrices, node: int, interfaces: tuple[ModelInterface, ...]) -> FloatArray:
    """(n, 6) a unit force and a unit moment at a node along each axis.

    A moment on a node without rotations is applied to the nodes of its elements with the weights by
    which they define its rotation. A load on a node of a rigid interface is zero: it acts on the
    interface, whose motion the basis contains.
    """
    rigid = [part for part in interfaces if isinstance(part, RigidInterface)]
    F = np.zeros((fe.numbering.n_all, 6))
    if any(node in part.nodes for part in rigid):
        return F[: fe.numbering.n]
    table = fe.numbering.table[node]
    for c in range(6):
        if table[c] >= 0:
            F[table[c], c] = 1.0
    if table[3] < 0:
        met = 0
        for block in fe.blocks:
            cells, corners = np.nonzero(block.nodes == node)
            if block.family.rotations or not len(cells):
                continue
            curl = block.family.rotation(fe.mesh.points[block.nodes[cells]])
            rows = curl[np.arange(len(cells)), corners]  # (cells, 3, d)
            for dofs, row in zip(fe.numbering.of(block.nodes[cells], 3), rows, strict=True):
                F[dofs, 3:] += row.T
            met += len(cells)
        F[:, 3:] /= max(met, 1)
    return condensed_load(fe, F)


def _omitted(
    fe: FEMatrices, basis: ReducedBasis, elastic: ReducedModes, F: FloatArray
) -> OmittedModes | None:
    """The omitted modes, minus what the basis contains of them; None if nothing is left."""
    if basis.omitted is None or not basis.omitted.shape[1]:
        return None
    modes = elastic.omega2, elastic.Phi
    Y = _at_rest(fe, basis, _missing_part(fe, basis.omitted, modes))
    energy = np.sum(basis.omitted * (fe.K @ basis.omitted), axis=0)
    # A rest without strain is a rigid motion, not a slow vibration.
    Y = Y[:, np.sum(Y * (fe.K @ Y), axis=0) > _COVERED_ENERGY * energy]
    if not Y.shape[1]:
        return None
    K, M = Y.T @ (fe.K @ Y), Y.T @ (fe.M @ Y)
    sizes, Q = eigh(0.5 * (M + M.T), 0.5 * (K + K.T))  # sizes are 1/ω² of the independent rest
    there = sizes > _RANK_TOLERANCE * sizes[-1]
    Y, sizes = Y @ (Q[:, there] / np.sqrt(sizes[there]))[:, ::-1], sizes[there][::-1]
    made = OmittedModes(
        1.0 / (2.0 * np.pi * np.sqrt(sizes)),
        -Y.T @ inertia_loads(fe),
        -(fe.M @ Y).T @ modes[1],
        Y.T @ F,
    )
    if basis.accelerations is None or basis.inertia is None:
        return made
    X = np.concatenate([basis.inertia, basis.accelerations @ elastic.Z], axis=1)
    missing = _missing_part(fe, X, modes)
    here = np.hstack([made.inertia, made.modes])
    rest = missing.T @ (fe.K @ missing) - here.T @ (here * sizes[:, None])
    full = np.sqrt(np.sum(X * (fe.K @ X), axis=0).clip(0.0))  # of unlike units
    scale = np.divide(1.0, full, out=np.zeros_like(full), where=full > 0.0)
    values, vectors = np.linalg.eigh(0.5 * (rest + rest.T) * np.outer(scale, scale))
    values = np.where(values > _ENERGY_ROUND_OFF, values, 0.0)
    vectors = full[:, None] * vectors
    return replace(made, rest=(vectors * values) @ vectors.T)


def _at_rest(fe: FEMatrices, basis: ReducedBasis, Y: FloatArray) -> FloatArray:
    """Missing parts Y (n, r) plus rigid motions, so that interfaces are at rest in them.

    The modes have no rigid motion, so that what is left of a field without them has one. Forces at
    interfaces would do work in it.
    """
    if not basis.interfaces:
        return InertiaRelief(fe.M, fe.rigid).fields(Y)
    moved, turned = (basis.interfaces[0].motion(fields) for fields in (Y, fe.rigid))
    return np.asarray(Y - fe.rigid @ np.linalg.lstsq(turned, moved, rcond=None)[0])
