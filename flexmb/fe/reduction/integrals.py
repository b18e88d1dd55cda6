"""Inertia integrals of the model reduced onto its modes, exact for all families.

In: the model's inertia and the modes. Out: :class:`Integrals` in the notation of the flexible
body: p = int rho N_b Phi, P = int rho s_a N_b Phi, Mab = Phi^T int rho N_a^T N_b Phi.
"""

from __future__ import annotations

from dataclasses import dataclass

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.flexbody.arrays import FloatArray

__all__ = ["Integrals", "integrals"]


@dataclass(frozen=True, eq=False)
class Integrals:
    """What the inertia of a flexible body needs, as in :class:`flexmb.flexbody.FlexBody`."""

    mass: float
    S1: FloatArray
    S0: FloatArray
    p: FloatArray
    P: FloatArray
    Mab: FloatArray


def integrals(fe: FEMatrices, Phi: FloatArray) -> Integrals:
    """Reduce the inertia of a model onto modes ``Phi`` (n, m)."""
    inertia, everywhere = fe.inertia, fe.expand(Phi)
    return Integrals(
        float(inertia.mass),
        inertia.S1,
        inertia.S0,
        inertia.p @ everywhere,
        inertia.P @ everywhere,
        fe.reduced_mass(Phi),
    )
