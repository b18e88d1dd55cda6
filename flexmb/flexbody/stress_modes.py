"""Stress of a body, section forces of its beams, force and moment resultants of its shells.

All are linear in the modal coordinates eta, so components of any motion are superposed. The von
Mises and principal stresses are not linear: they are computed from the summed components. Source:
Huber (1904) and von Mises (1913), in Timoshenko, Strength of Materials, part II.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmb.flexbody.arrays import Checker, FloatArray, IntArray
from flexmb.flexbody.parts import set_fields

STRESS = ("xx", "yy", "zz", "yz", "zx", "xy")
"""Order of stress components, body axes."""
SECTION_FORCES = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Order of section forces: normal force, shear forces, torque, bending moments."""
SHELL_FORCES = ("Nx", "Ny", "Nxy", "Mx", "My", "Mxy", "Qx", "Qy")
"""Order of the resultants of a shell, per length: membrane forces, moments, transverse forces."""


def von_mises(stress: FloatArray) -> FloatArray:
    """(...) the von Mises stress of components (..., 6) in the order of ``STRESS``.

    >>> von_mises(np.array([100.0, 0, 0, 0, 0, 0])).item()
    100.0
    """
    xx, yy, zz, yz, zx, xy = np.moveaxis(np.asarray(stress), -1, 0)
    apart = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.asarray(np.sqrt(0.5 * apart + 3.0 * (yz**2 + zx**2 + xy**2)))


def principal_stresses(stress: FloatArray) -> FloatArray:
    """(..., 3) the principal stresses of components (..., 6), the largest first.

    >>> principal_stresses(np.array([0.0, 0, 0, 0, 0, 100.0])).tolist()
    [100.0, 0.0, -100.0]
    """
    tensor = np.asarray(stress, dtype=float)[..., [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    return np.asarray(np.linalg.eigvalsh(tensor)[..., ::-1])


@dataclass(frozen=True, eq=False)
class StressModes:
    """Stress at places of the body per unit modal coordinate.

    A place is a mesh node, a section of the body and a layer of it: where two sections, or two
    shells at an angle, meet at a node, each has a place of its own there. Single precision, seven
    digits, is more than the stress of a mesh holds and halves the file.

    Parameters
    ----------
    ids : (k,) int
        Mesh node of each place, ascending.
    part, layer : (k,) int
        Which of ``parts`` and of ``layers`` each place belongs to.
    parts : tuple of str
        Sections, by the mesh group that gave them.
    layers : tuple of str
        Places across a section: ``"bottom"`` and ``"top"`` of shells, stress points of beams,
        and ``"solid"``.
    modes : (k, 6, m) float32
        Stress per unit modal coordinate, xx yy zz yz zx xy in body axes [Pa].
    """

    ids: IntArray
    part: IntArray
    layer: IntArray
    parts: tuple[str, ...]
    layers: tuple[str, ...]
    modes: NDArray[np.float32]

    def __post_init__(self) -> None:
        check = Checker("stress")
        set_fields(self, ids=check.integers("ids", self.ids, (None,)))
        k = len(self.ids)
        for name in ("part", "layer"):
            set_fields(self, **{name: check.integers(name, getattr(self, name), (k,))})
            names = tuple(str(text) for text in getattr(self, f"{name}s"))
            set_fields(self, **{f"{name}s": names})
            rows = getattr(self, name)
            if rows.size and not (rows.min() >= 0 and rows.max() < len(names)):
                check.add(name, f"points outside the {len(names)} names of {name}s")
        set_fields(self, modes=check.floats("modes", self.modes, (k, 6, None), np.float32))
        if (np.diff(self.ids) < 0).any():
            check.add("ids", "must be ascending")
        check.raise_problems()

    def layer_and_part(self, words: Sequence[str]) -> tuple[str | None, str | None]:
        """The layer and the section that words of a name state: top, skin, or top and skin.

        What is neither is returned as a layer.
        """
        text = ".".join(words)
        if not text or text in self.layers:
            return text or None, None
        if text in self.parts:
            return None, text
        layer, _, part = text.partition(".")
        return (layer, part) if part in self.parts else (text, None)

    def rows(
        self, node: int | None = None, layer: str | None = None, part: str | None = None
    ) -> IntArray:
        """Places at a mesh node, of a layer and a section; None takes all. Empty if there are
        none."""
        selected = np.ones(len(self.ids), dtype=bool)
        if node is not None:
            selected &= self.ids == node
        if layer is not None:
            number = self.layers.index(layer) if layer in self.layers else -1
            selected &= self.layer == number
        if part is not None:
            selected &= self.part == (self.parts.index(part) if part in self.parts else -1)
        return np.flatnonzero(selected)

    def place_names(self, rows: IntArray) -> str:
        """Layers and sections of places, as words of a name: top.skin, top.spar."""
        places = zip(self.layer[rows], self.part[rows], strict=True)
        return ", ".join(sorted({f"{self.layers[i]}.{self.parts[k]}" for i, k in places}))

    def at(self, eta: FloatArray, rows: IntArray | slice = slice(None)) -> FloatArray:
        """(..., k, 6) stress for modal coordinates (..., m) at all places, or at some rows [Pa]."""
        modes = self.modes[rows]
        flat = modes.reshape(-1, self.modes.shape[-1]).astype(np.float64)
        return np.asarray((eta @ flat.T).reshape(*np.shape(eta)[:-1], len(modes), 6))

    def combined(self, Z: FloatArray) -> StressModes:
        """Stress in the modes Phi Z with Z (m, k)."""
        return replace(self, modes=(self.modes @ Z).astype(np.float32))


@dataclass(frozen=True, eq=False)
class SectionForceModes:
    """Section forces at both ends of each beam element per unit modal coordinate.

    They are exerted by the part of the beam beyond the section on the part before it, in the order
    ``SECTION_FORCES``, along the local axes and about the centroid. A tensile N is positive, a
    positive Mz puts the fibres at negative y in tension, a positive My those at positive z.

    Parameters
    ----------
    elements : (b, 2) int
        Mesh nodes of the beam elements.
    axes : (b, 3, 3) float
        Local axes x (along the beam), y, z as columns, body frame.
    modes : (b, 2, 6, m) float
        N, Vy, Vz [N] and T, My, Mz [N m] at the first and at the second node.
    """

    elements: IntArray
    axes: FloatArray
    modes: FloatArray

    def __post_init__(self) -> None:
        check = Checker("section_forces")
        set_fields(self, elements=check.integers("elements", self.elements, (None, 2)))
        b = len(self.elements)
        set_fields(self, axes=check.floats("axes", self.axes, (b, 3, 3)))
        set_fields(self, modes=check.floats("modes", self.modes, (b, 2, 6, None)))
        check.raise_problems()

    def at(self, eta: FloatArray) -> FloatArray:
        """(..., b, 2, 6) section forces for modal coordinates (..., m) [N, N m]."""
        forces = eta @ self.modes.reshape(-1, self.modes.shape[-1]).T
        return np.asarray(forces.reshape(*np.shape(eta)[:-1], len(self.elements), 2, 6))

    def combined(self, Z: FloatArray) -> SectionForceModes:
        """Section forces in the modes Phi Z with Z (m, k)."""
        return replace(self, modes=self.modes @ Z)


@dataclass(frozen=True, eq=False)
class ShellForceModes:
    """Resultants over the thickness of shells at their nodes per unit modal coordinate.

    Per length, in the order ``SHELL_FORCES``, along local axes x (direction of material axis 1), y
    and z (normal). N is positive in tension; on a cut with normal x, a positive Mx puts the top in
    tension (M = int z sigma dz), and Qx is the shear force along z.

    Parameters
    ----------
    ids : (k,) int
        Mesh node of each place, ascending; a node has one for each section or fold that meets it.
    part : (k,) int
        Which of ``parts`` it belongs to.
    parts : tuple of str
        Sections, by the mesh group that gave them.
    axes : (k, 3, 3) float
        Local axes x, y, z as columns, body frame.
    modes : (k, 8, m) float32
        [N/m] and, of moments, [N].
    """

    ids: IntArray
    part: IntArray
    parts: tuple[str, ...]
    axes: FloatArray
    modes: NDArray[np.float32]

    def __post_init__(self) -> None:
        check = Checker("shell_forces")
        set_fields(self, ids=check.integers("ids", self.ids, (None,)))
        k = len(self.ids)
        set_fields(self, part=check.integers("part", self.part, (k,)))
        set_fields(self, parts=tuple(str(text) for text in self.parts))
        if self.part.size and not (self.part.min() >= 0 and self.part.max() < len(self.parts)):
            check.add("part", f"points outside the {len(self.parts)} names of parts")
        set_fields(self, axes=check.floats("axes", self.axes, (k, 3, 3)))
        set_fields(self, modes=check.floats("modes", self.modes, (k, 8, None), np.float32))
        check.raise_problems()

    def at(self, eta: FloatArray, rows: IntArray | slice = slice(None)) -> FloatArray:
        """(..., k, 8) resultants for modal coordinates (..., m) [N/m, N]."""
        modes = self.modes[rows]
        flat = modes.reshape(-1, self.modes.shape[-1]).astype(np.float64)
        return np.asarray((eta @ flat.T).reshape(*np.shape(eta)[:-1], len(modes), 8))

    def combined(self, Z: FloatArray) -> ShellForceModes:
        """Resultants in the modes Phi Z with Z (m, k)."""
        return replace(self, modes=(self.modes @ Z).astype(np.float32))


@dataclass(frozen=True, eq=False)
class OmittedStress:
    """Stress under the body's own inertia loads that its modes lack (mode-acceleration method).

    Per unit of the twelve numbers of :class:`~flexmb.flexbody.static_response.InertiaResponse`:
    stress of the static responses of the full model, interfaces fixed, minus what the modes contain
    of them. None if the body has no such stress.

    Parameters
    ----------
    stress : (k, 6, 12) float32, optional
        At the places of its :class:`StressModes`.
    section_forces : (b, 2, 6, 12) float, optional
        Section forces of its beams.
    shell_forces : (h, 8, 12) float32, optional
        Resultants of its shells.
    """

    stress: NDArray[np.float32] | None = None
    section_forces: FloatArray | None = None
    shell_forces: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        check = Checker("omitted stress")
        shapes: dict[str, tuple[tuple[int | None, ...], type]] = {
            "stress": ((None, 6, 12), np.float32),
            "section_forces": ((None, 2, 6, 12), np.float64),
            "shell_forces": ((None, 8, 12), np.float32),
        }
        for name, (shape, kind) in shapes.items():
            if getattr(self, name) is not None:
                set_fields(self, **{name: check.floats(name, getattr(self, name), shape, kind)})
        check.raise_problems()
