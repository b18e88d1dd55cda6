"""What large displacements would change in a static solution of linear theory.

Along a static solution u, scaled by s, a part has the strain energy K s²/2 + C s³ + V s⁴/2: K = uᵀ
K u, C the work of its stress at its strains of second order, and V the energy of these after all
points have moved to where it is least. Under the load of u it is in equilibrium where K s + 3 C s²
+ 2 V s³ = K, the first such s that is positive. For plates this is Galerkin's solution of von
Karman's equations by one function (Timoshenko & Woinowsky-Krieger, Theory of Plates and Shells,
§100-102).
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface
from flexmb.fe.assembly.second_order_strains import has_second_order_strains, second_order_loads
from flexmb.fe.assembly.supports import Supports
from flexmb.fe.reduction.fixed_interface import BorderedSolver
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.membrane_stiffness import small_load
from flexmb.units import percent

_LARGEST_DISPLACEMENT = 0.1  # over the size of the part, from which on linear theory is doubtful
_ROUND_OFF = 1e-9  # of displacements of supports, over the largest
_LARGEST_CHANGE, _SMALL_CHANGE = 0.05, 0.01  # of displacements: from which on it is told; small


def displacement_notes(
    fe: FEMatrices,
    ends: tuple[ModelInterface, ...],
    supports: Supports,
    solver: BorderedSolver,
    z: FloatArray,
) -> list[str]:
    """Sentences on a static solution whose displacements are too large for linear theory.

    Parameters
    ----------
    fe, ends, supports : FEMatrices, tuple of interfaces, Supports
        The model and how it is held.
    solver : BorderedSolver
        Its stiffness over the coordinates that are not held.
    z : (k,) float
        The solution. Of a rigid motion of all supports it is taken relative to that.
    """
    if not len(supports.fixed):
        return []
    moved = np.linalg.lstsq(supports.rigid[supports.fixed], supports.value)[0]
    u = supports.G @ z - fe.rigid @ moved
    places = fe.numbering.table[fe.numbering.nodes, :3]
    largest = np.linalg.norm(fe.expand(u)[places], axis=1).max(initial=0.0)
    size = float(np.linalg.norm(np.ptp(fe.mesh.points[fe.numbering.nodes], axis=0)))
    notes = []
    if largest > _LARGEST_DISPLACEMENT * size:
        notes.append(
            f"the largest displacement is {largest / size:.2g} of the size of the part: linear "
            f"theory holds up to about {_LARGEST_DISPLACEMENT:g}; give smaller loads"
        )
    rest = np.abs(supports.value - supports.rigid[supports.fixed] @ moved).max()
    as_one = rest <= _ROUND_OFF * np.abs(supports.value).max() and not supports.mean.any()
    if largest > 0.0 and as_one and has_second_order_strains(fe):
        notes += _membrane_notes(fe, ends, supports, solver, u)
    return notes


def _membrane_notes(
    fe: FEMatrices,
    ends: tuple[ModelInterface, ...],
    supports: Supports,
    solver: BorderedSolver,
    u: FloatArray,
) -> list[str]:
    """The sentence on forces that linear theory leaves out, if they change displacements."""
    turns = [end.motion(u[:, None])[3:] for end in ends]
    F, direct = second_order_loads(fe, u[:, None], ends, turns)
    f = (supports.G.T @ F[:, 0])[supports.free]
    K, C = float(u @ (fe.K @ u)), float(u @ F[:, 0])
    V = float(direct[0, 0]) - float(f @ solver.solve(f)) + C**2 / K
    about = np.roots([2 * V, 3 * C, K, -K])
    equilibria = about.real[(np.abs(about.imag) < 1e-9) & (about.real > 0.0)]
    cause = "membrane forces, which linear theory leaves out, would"
    if not len(equilibria):
        return [f"{cause} buckle the part before its loads act in full"]
    change = 1.0 - equilibria.min()
    if abs(change) < _LARGEST_CHANGE:
        return []

    def excess(s: float) -> float:
        left_out = 3 * C * s**2 + 2 * V * s**3
        return abs(left_out) / (K * s + left_out) - _SMALL_CHANGE

    s = small_load(excess, float(equilibria.min()))
    load = s + (3 * C * s**2 + 2 * V * s**3) / K
    verb = "reduce" if change > 0.0 else "increase"
    return [
        f"{cause} {verb} displacements by about {percent(abs(change))}; by less than 1 % up to "
        f"about {load:.2g} of these loads"
    ]
