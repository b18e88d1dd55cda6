"""What an element family gives: the matrices of all elements of one kind at once.

In: node coordinates x (ne, k, 3) [m] in the body frame, in the mesh's (VTK's) node order, and the
section they share. Out: batches of element matrices in body axes. Degrees of freedom run node by
node: three displacements, and three rotations where the family has them; d is their number.
Stresses are in the order xx, yy, zz, yz, zx, xy, body axes [Pa].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from flexmb.flexbody.arrays import FloatArray, IntArray

STRESS = ("xx", "yy", "zz", "yz", "zx", "xy")
"""Order of stress components."""


@dataclass(frozen=True, eq=False)
class ScalarMass:
    """Mass of elements whose nodes only displace, and whose position and displacement share one
    interpolation.

    Parameters
    ----------
    M : (ne, k, k) float
        int rho N_i N_j [kg].
    """

    M: FloatArray


@dataclass(frozen=True, eq=False)
class ComponentMass:
    """Mass of elements with nodal rotations, by components of the displacement.

    With N_a (1, d) the interpolation of the displacement along a of a material point, rotations of
    the section included, and s its reference position: each integral is exact.

    Parameters
    ----------
    Mab : (ne, 3, 3, d, d) float
        int rho N_a^T N_b.
    P : (ne, 3, 3, d) float
        int rho s_a N_b.
    p : (ne, 3, d) float
        int rho N_b.
    mass : (ne,) float
        kg.
    S1 : (ne, 3) float
        int rho s.
    S0 : (ne, 3, 3) float
        int rho s s^T.
    """

    Mab: FloatArray
    P: FloatArray
    p: FloatArray
    mass: FloatArray
    S1: FloatArray
    S0: FloatArray


class Family(Protocol):
    """A kind of element; one object for each, in :mod:`flexmb.fe.elements.element_blocks`."""

    kind: str  # name of the cells in a mesh
    about: str  # a sentence for the list of elements
    dimension: int  # 1 beam, 2 shell, 3 solid
    rotations: bool  # nodes carry rotations too
    warning: str  # a warning for its users; empty if none
    faces: tuple[tuple[int, ...], ...]  # local nodes of outer faces: corners, then mid-sides
    edges: tuple[tuple[int, int], ...]  # corners of straight edges: for checks and drawing

    def measure(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne,) volume, area or length."""
        ...

    def defects(self, x: FloatArray) -> IntArray:
        """Rows of elements that are flat, folded or without length."""
        ...

    def stiffness(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, d, d) stiffness."""
        ...

    def mass(self, x: FloatArray, section: Any) -> ScalarMass | ComponentMass:
        """Consistent mass."""
        ...

    def geometric_stiffness(self, x: FloatArray, section: Any, u: FloatArray) -> FloatArray:
        """(ne, d, d) geometric stiffness of the stress that displacements u (ne, d) cause."""
        ...

    def stress_layers(self, section: Any) -> tuple[str, ...]:
        """Names of the places across the section where stress is reported: top, bottom, ..."""
        ...

    def stress(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, k, layers, 6, d) stress at the nodes per unit of each degree of freedom."""
        ...

    def rotation(self, x: FloatArray) -> FloatArray:
        """(ne, k, 3, d) rotation at the nodes per unit of each degree of freedom.

        Half the curl of the displacement where nodes carry no rotations.
        """
        ...
