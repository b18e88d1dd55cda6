"""Statics and closed forms that tests of solid elements compare with."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import splu
from skfem.quadrature import get_quadrature
from skfem.refdom import RefQuad, RefTri


def held(fe, *groups):
    """Degrees of freedom of pairs of a group and directions, such as ("x0", "xyz")."""
    table, sets = fe.numbering.table, fe.mesh.node_sets
    parts = [table[sets[name], "xyz".index(axis)] for name, axes in groups for axis in axes]
    return np.unique(np.concatenate(parts))


def solve(fe, f, held, moved=0.0):
    """Displacements under loads ``f`` with degrees of freedom ``held`` at ``moved``."""
    u = np.zeros(fe.numbering.n)
    u[held] = moved
    free = np.setdiff1d(np.arange(len(u)), held)
    K = fe.K.tocsc()
    u[free] = splu(K[free][:, free]).solve(f[free] - K[free][:, held] @ u[held])
    return u


def nodal_stress(fe, u):
    """(nodes, 6) mean over the elements that meet at each node."""
    (block,) = fe.blocks
    local = u[fe.numbering.of(block.nodes, 3)]
    per_unit = block.family.stress(fe.mesh.points[block.nodes], block.section)[:, :, 0]
    total = np.zeros((len(fe.mesh.points), 6))
    np.add.at(total, block.nodes, np.einsum("ekld,ed->ekl", per_unit, local))
    return total / np.bincount(block.nodes.ravel(), minlength=len(total))[:, None]


def pressure(fe, nodes, value):
    """Loads of a pressure along -z on the level faces whose nodes are all among ``nodes``."""
    (block,) = fe.blocks
    reference, f = block.family.reference, np.zeros(fe.numbering.n)
    for face in block.family.faces:
        rows = np.isin(block.nodes[:, face], nodes).all(axis=1)
        corners = [node for node in face if node < reference.corners]
        origin, along, across = reference.nodes[[corners[0], corners[1], corners[-1]]]
        X, w = get_quadrature(RefTri if len(corners) == 3 else RefQuad, 5)
        along, across = along - origin, across - origin
        N, dN = reference.shapes(origin + X.T @ np.stack([along, across]))
        x = fe.mesh.points[block.nodes[rows]]
        sides = [np.einsum("i,qin,ena->qea", side, dN, x) for side in (along, across)]
        area = w[:, None] * np.linalg.norm(np.cross(*sides), axis=2)
        loads = -value * np.einsum("qn,qe->en", N, area)
        np.add.at(f, fe.numbering.table[block.nodes[rows], 2], loads)
    return f


def clamped_block(size, counts, material, modes):
    """Circular frequencies of a block clamped at x = 0, by the method of Ritz, from above.

    Displacements are products of Legendre polynomials, ``counts`` along x, y, z, times x.
    """
    along = [
        _products(n, L, axis == 0) for axis, (n, L) in enumerate(zip(counts, size, strict=True))
    ]

    def integral(a, b):
        x, y, z = (along[axis][int(axis == a), int(axis == b)] for axis in range(3))
        return np.kron(np.kron(x, y), z)

    H = [[integral(a, b) for b in range(3)] for a in range(3)]
    mu = material.G
    lam = 2 * mu * material.nu / (1 - 2 * material.nu)
    shear = mu * sum(H[a][a] for a in range(3))
    K = [
        [lam * H[c][d] + mu * H[d][c] + (shear if c == d else 0) for d in range(3)]
        for c in range(3)
    ]
    M = np.kron(np.eye(3), material.density * integral(-1, -1))
    values = eigh(np.block(K), M, eigvals_only=True, subset_by_index=[0, modes - 1])
    return np.sqrt(values)


def _products(n, length, clamped):
    """[p, q] integrals of products of polynomials (0) and of their slopes (1)."""
    s, w = np.polynomial.legendre.leggauss(n + 1)
    shapes = [np.polynomial.Legendre.basis(k) for k in range(n)]
    if clamped:
        shapes = [shape * np.polynomial.Legendre([0.5, 0.5]) for shape in shapes]
    values = np.stack([shape(s) for shape in shapes])
    slopes = np.stack([shape.deriv()(s) for shape in shapes]) * 2 / length
    pair, w = (values, slopes), w * length / 2
    return {(p, q): (pair[p] * w) @ pair[q].T for p in range(2) for q in range(2)}
