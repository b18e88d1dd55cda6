"""Membrane forces of flexible plates and shells: they stretch as they bend (von Kármán).

With the coordinates a = A η of k shapes and the products y of these by pairs, such a body has the
strain energy ηᵀ C y + yᵀ V y/2 beside ηᵀ K η/2 (`flexbody.membrane_stiffness`). Its derivatives by
η are forces and a stiffness of the modes, both exact. The body's part of the pool holds A (k, m),
Cᵀ (p, m) and V (p, p), with p = k (k + 1)/2 pairs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.ldl import add_body_block
from flexmb.engine.algebra.vector import clear, dot, zero
from flexmb.engine.jit import Integers, Matrix, Vector, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import STRAIN_ENERGY, Point, Run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexmb.flexbody import MembraneStiffness


class Scratch(NamedTuple):
    """Scratch of one body at a time."""

    a: Vector  # (k,) coordinates of the shapes
    change: Vector  # (k,)
    W: Matrix  # (k, k) stiffness of the shapes
    R: Matrix  # (k, m)


class MembraneForces(NamedTuple):
    """Bodies with membrane forces."""

    rows: Integers  # their rows in the table of bodies
    sizes: Integers  # (2,) largest numbers of shapes and of modes
    scratch: Scratch = None  # of one run


def membrane_block(stiffness: MembraneStiffness) -> NDArray[np.float64]:
    """A, Cᵀ and V in one row."""
    parts = (stiffness.shapes, stiffness.linear.T, stiffness.quadratic)
    return np.concatenate([np.ascontiguousarray(part).ravel() for part in parts])


def tabulate_membrane_forces(bodies: NDArray[np.void]) -> MembraneForces | None:
    """The bodies with shapes; None if there are none."""
    rows = np.flatnonzero(bodies["shapes"])
    sizes: Sequence[int] = [int(bodies[name].max(initial=0)) for name in ("shapes", "m")]
    return MembraneForces(rows, np.array(sizes, np.int64)) if len(rows) else None


def new_scratch(of: MembraneForces) -> Scratch:
    k, m = (int(size) for size in of.sizes)
    return Scratch(np.zeros(k), np.zeros(k), np.zeros((k, k)), np.zeros((k, m)))


@kernel
def _put_coordinates(body, pool, q, a):
    """a = A η."""
    m = body["m"]
    for i in range(body["shapes"]):
        a[i] = dot(pool, body["membrane"] + i * m, q, body["iq"] + 7, m)


@kernel
def _of_pairs(pool, at, a, k):
    """One row of V, at `at`, times y."""
    x = 0.0
    for i in range(k):
        for j in range(i, k):
            x += pool[at] * a[i] * a[j]
            at += 1
    return x


@kernel
def membrane_energy(body, pool, q, a):
    """ηᵀ C y + yᵀ V y/2 of one body [J]; a is scratch of `shapes` numbers."""
    m, k, energy = body["m"], body["shapes"], 0.0
    pairs, C = k * (k + 1) // 2, body["membrane"] + k * m
    V, p = C + pairs * m, 0
    _put_coordinates(body, pool, q, a)
    for i in range(k):
        for j in range(i, k):
            stress = dot(pool, C + p * m, q, body["iq"] + 7, m)
            energy += a[i] * a[j] * (stress + 0.5 * _of_pairs(pool, V + p * pairs, a, k))
            p += 1
    return energy


@unit
def add_membrane_forces(run: Run, of: MembraneForces, at: Point) -> int:
    """Trial.res += C y + (∂y/∂η)ᵀ (Cᵀ η + V y)."""
    pool, out, s = run.system.parts.pool, run.work.trial.res, of.scratch
    for n in range(of.rows.shape[0]):
        body = run.system.parts.bodies[of.rows[n]]
        m, k, o = body["m"], body["shapes"], body["iv"] + 6
        pairs, C = k * (k + 1) // 2, body["membrane"] + k * m
        V, p = C + pairs * m, 0
        _put_coordinates(body, pool, at.q, s.a)
        zero(s.change)
        for i in range(k):
            for j in range(i, k):
                stress = dot(pool, C + p * m, at.q, body["iq"] + 7, m)
                stress += _of_pairs(pool, V + p * pairs, s.a, k)
                y = s.a[i] * s.a[j]
                for r in range(m):
                    out[o + r] += y * pool[C + p * m + r]
                s.change[i] += stress * s.a[j]
                s.change[j] += stress * s.a[i]
                p += 1
        for i in range(k):
            for r in range(m):
                out[o + r] += s.change[i] * pool[body["membrane"] + i * m + r]
    return SUCCESS


@kernel
def _put_shape_stiffness(body, pool, q, s):
    """s.W and s.R: with R = Cᵀ by shapes + W A/2 the stiffness is Rᵀ A + Aᵀ R."""
    m, k, a, u, W, R = body["m"], body["shapes"], s.a, s.change, s.W, s.R
    pairs, C = k * (k + 1) // 2, body["membrane"] + k * m
    V, p = C + pairs * m, 0
    _put_coordinates(body, pool, q, a)
    clear(W, k, k)
    clear(R, k, m)
    for i in range(k):
        for j in range(i, k):
            stress = dot(pool, C + p * m, q, body["iq"] + 7, m)
            stress += _of_pairs(pool, V + p * pairs, a, k)
            zero(u)
            at = V + p * pairs
            for b in range(k):
                for c in range(b, k):
                    u[b] += pool[at] * a[c]
                    u[c] += pool[at] * a[b]
                    at += 1
            for b in range(k):
                W[i, b] += a[j] * u[b]
                W[j, b] += a[i] * u[b]
            W[i, j] += stress
            W[j, i] += stress
            for r in range(m):
                R[i, r] += a[j] * pool[C + p * m + r]
                R[j, r] += a[i] * pool[C + p * m + r]
            p += 1
    for i in range(k):
        for j in range(k):
            for r in range(m):
                R[i, r] += 0.5 * W[i, j] * pool[body["membrane"] + j * m + r]


@unit
def add_membrane_stiffness(run: Run, of: MembraneForces, at: Point, cv: float, cp: float) -> int:
    """Add cp times the derivative of the forces by η to the matrix."""
    if cp == 0.0:
        return SUCCESS
    pool, B = run.system.parts.pool, run.work.dense.B
    for n in range(of.rows.shape[0]):
        body, R = run.system.parts.bodies[of.rows[n]], of.scratch.R
        m, A = body["m"], body["membrane"]
        _put_shape_stiffness(body, pool, at.q, of.scratch)
        clear(B, 6 + m, 6 + m)
        for i in range(body["shapes"]):
            for r in range(m):
                for c in range(m):
                    both = R[i, r] * pool[A + i * m + c] + pool[A + i * m + r] * R[i, c]
                    B[6 + r, 6 + c] += cp * both
        add_body_block(run, of.rows[n], B)
    return SUCCESS


@unit
def add_membrane_energy(run: Run, of: MembraneForces, at: Point) -> int:
    """Strain energy of stretching."""
    for n in range(of.rows.shape[0]):
        body = run.system.parts.bodies[of.rows[n]]
        run.work.energies[STRAIN_ENERGY] += membrane_energy(
            body, run.system.parts.pool, at.q, of.scratch.a
        )
    return SUCCESS


MEMBRANE_FORCES = Kind(
    "membrane_forces",
    MembraneForces,
    {"force": add_membrane_forces, "matrix": add_membrane_stiffness, "energy": add_membrane_energy},
    stiff=True,
    scratch=new_scratch,
)
