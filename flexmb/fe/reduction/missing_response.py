"""What a reduced basis lacks of the full model's answers: to inertia, to loads at nodes, and modes.

With X the static responses of the full model and Φ the modes, orthogonal in K,
Y = X − Φ (Φᵀ K X)/ω² is what they lack of X, and the strain energy of any sum of loads splits into
that of both. Modes that are left out are treated likewise: what Φ has of them is taken out, and the
rest vibrates by itself, driven by the inertia of all other motion and by loads. Interfaces are
held, and loads on them drive nothing, where their constraint modes are in the basis; modes of the
user's own are judged by the free body, and loads at its interfaces are among those that they may
lack.
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
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.fe.reduction.free_body import relieved_inverse
from flexmb.fe.reduction.inertia_relief import InertiaRelief, inertia_loads
from flexmb.fe.reduction.reduced_basis import ReducedBasis, ReducedModes
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.static_response import InertiaResponse, LoadResponse, OmittedModes, load_nodes
from flexmb.progress import Progress, silent

_ENERGY_ROUND_OFF = 1e-10  # share of the largest energy of a response
_COVERED = 0.01  # share of a mode's strain energy that the basis leaves: it has this mode
_INSIDE = 1e-8  # share of a mode's strain energy that the basis leaves: less is in it


def inertia_response(
    fe: FEMatrices, basis: ReducedBasis, elastic: ReducedModes
) -> InertiaResponse | None:
    """Energies of the static responses to inertia loads, and what the modes lack of them."""
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
    """(n, 12) what the modes lack of the static responses to inertia loads; None if nothing."""
    X = basis.inertia
    if X is None:
        return None
    Y = _beside(fe, X, (elastic.omega2, elastic.Phi))
    full, lacks = (np.einsum("nr,nr->r", Z, fe.K @ Z) for Z in (X, Y))
    counts = lacks > _ENERGY_ROUND_OFF * full.max()
    return np.where(counts, Y, 0.0) if counts.any() else None


def missing_energy_forms(fe: FEMatrices, X: FloatArray, modes: Modes) -> tuple[FloatArray, ...]:
    """Forms (r, r) over responses X (n, r): strain energy, what modes lack of it, its motion.

    The modes are orthogonal to each other in K, of unit modal mass.
    """
    Y = _beside(fe, X, modes)
    moved = InertiaRelief(fe.M, fe.rigid).fields(Y)
    forms = (X.T @ (fe.K @ X), Y.T @ (fe.K @ Y), moved.T @ (fe.M @ moved))
    return tuple(0.5 * (form + form.T) for form in forms)


def _beside(fe: FEMatrices, X: FloatArray, modes: Modes) -> FloatArray:
    """What modes lack of fields X (n, r)."""
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
    """The body with its answers to loads at nodes, and with the modes that it leaves out.

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
    if basis.inertia is None:  # modes of the user's own
        names = range(len(ends))
        nodes = [*nodes, *(-1 - k for k in names)]
        for part in ends:
            f = np.zeros((fe.numbering.n, 6))
            dofs, values = part.loads()
            f[dofs] = values
            loads.append(f)
    relief = InertiaRelief(fe.M, fe.rigid)
    rest = [load for load in basis.loads if not load.residual]
    if free:  # what moves the body as a whole deforms nothing
        norm = np.linalg.norm
        rest = [x for x in rest if norm(relief.loads(x.f)) > _INSIDE * norm(x.f)]
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
        solve = FixedInterfaceModel(fe, ends, basis.directions, progress).solve
    if loads:
        forms = missing_energy_forms(fe, solve(F), modes)
        if nodes:
            response = LoadResponse(np.array(nodes), *(form[at_nodes, at_nodes] for form in forms))
        body = _with_missing_shares(body, [load.name for load in rest], forms, at_nodes.stop)
    omitted = _omitted(fe, basis, modes, F[:, at_nodes])
    return replace(body, load_response=response, omitted_modes=omitted)


def _with_missing_shares(
    body: FlexBody, names: list[str], forms: tuple[FloatArray, ...], first: int
) -> FlexBody:
    """The body with what its modes lack of loads whose static response they need not hold."""
    full, lacks = (np.diag(form)[first:] for form in forms[:2])
    shares = dict(zip(names, lacks / np.where(full > 0.0, full, 1.0), strict=True))
    loads = (replace(load, missing_share=shares.get(load.name, 0.0)) for load in body.loads)
    return replace(body, loads=tuple(loads))


def node_loads(fe: FEMatrices, node: int, interfaces: tuple[ModelInterface, ...]) -> FloatArray:
    """(n, 6) a unit force and moment at a node along each axis.

    A moment on a node without rotation acts on the nodes around it, by which its rotation is known;
    what acts on a rigid interface acts on that, and needs no answer.
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
    fe: FEMatrices, basis: ReducedBasis, modes: Modes, F: FloatArray
) -> OmittedModes | None:
    """The modes that a basis leaves out, less what it has of them."""
    if basis.omitted is None or not basis.omitted.shape[1]:
        return None
    Y = _beside(fe, basis.omitted, modes)
    energy = np.sum(basis.omitted * (fe.K @ basis.omitted), axis=0)
    # beside modes and rigid motions: a rest without strain is a rigid motion, not a slow vibration
    Y = Y[:, np.sum(Y * (fe.K @ Y), axis=0) > _COVERED * energy]
    if not Y.shape[1]:
        return None
    K, M = Y.T @ (fe.K @ Y), Y.T @ (fe.M @ Y)
    sizes, Q = eigh(0.5 * (M + M.T), 0.5 * (K + K.T))  # 1/ω², of those that are independent
    there = sizes > _INSIDE * sizes[-1]
    Y = Y @ (Q[:, there] / np.sqrt(sizes[there]))[:, ::-1]
    MY = fe.M @ Y
    return OmittedModes(
        1.0 / (2.0 * np.pi * np.sqrt(sizes[there][::-1])),
        -Y.T @ inertia_loads(fe),
        -MY.T @ modes[1],
        Y.T @ F,
    )
