"""Checks of a model before it is reduced, and the table of its modes after.

In: a finite-element model, its interfaces, its modes. Out: sentences worth telling, an error for
what cannot be reduced, and one :class:`ModeInfo` for every candidate mode.
"""

from __future__ import annotations

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.checks.mass import mass_sentence
from flexmb.fe.checks.mesh import Finding, mesh_report, size_sentence
from flexmb.fe.interfaces.make import ModelInterface
from flexmb.fe.material import plausibility
from flexmb.fe.reduction.basis import STATIC, ReducedBasis
from flexmb.fe.reduction.orthonormal import ReducedModes
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.parts import ModeInfo

__all__ = ["mode_infos", "orphans", "suspicions"]

_RIGID = tuple(f"{kind} {axis}" for kind in ("translation", "rotation") for axis in "xyz")


def suspicions(
    fe: FEMatrices, interfaces: tuple[ModelInterface, ...], points: float = 0.0
) -> list[Finding]:
    """What is worth telling of a model: notes, and what hints at a slip in mesh, units or mass.

    Parameters
    ----------
    fe, interfaces
        The model.
    points : float
        Masses at its nodes [kg].

    Raises
    ------
    MeshError
        The mesh falls into parts that are joined neither by nodes nor by an interface, a tie or a
        spring.
    """
    linked = [part.nodes for part in (*interfaces, *fe.springs)]
    linked += [np.append(tie.nodes, tie.reference) for tie in fe.ties]
    found = mesh_report(fe.mesh, fe.blocks, linked)
    errors = [finding.sentence for finding in found if finding.level == "error"]
    if errors:
        raise MeshError.from_problems([Problem(fe.mesh.source, sentence) for sentence in errors])
    told = plausibility(fe.material)
    told.append(size_sentence(fe.mesh.points[fe.numbering.nodes]))
    told.append(mass_sentence(fe, points))
    return [*(Finding("warning", sentence) for sentence in told if sentence), *found]


def orphans(fe: FEMatrices) -> int:
    """How many nodes of the mesh belong to no element of the body (they are left out)."""
    return len(fe.mesh.points) - len(fe.numbering.nodes)


def mode_infos(
    fe: FEMatrices, reduced: ReducedBasis, modes: ReducedModes, Mab: FloatArray
) -> tuple[ModeInfo, ...]:
    """The six rigid motions, dropped, then the modal coordinates with their energy shares.

    Parameters
    ----------
    fe, reduced, modes
        The model, the reduced basis and the modes made of it.
    Mab : (3, 3, m, m) float
        Mass components reduced onto the modes.
    """
    R = fe.rigid
    energy, mass = np.sum(R * (fe.K @ R), axis=0), np.sum(R * (fe.M @ R), axis=0)
    residual = np.sqrt(np.maximum(energy / mass, 0.0)) / (2 * np.pi)
    why = "rigid motion"
    rigid = [
        ModeInfo(-1, "rigid", float(f), False, why, name)
        for f, name in zip(residual, _RIGID, strict=True)
    ]
    return (*rigid, *_elastic_infos(reduced, modes, Mab))


def _elastic_infos(reduced: ReducedBasis, modes: ReducedModes, Mab: FloatArray) -> list[ModeInfo]:
    static = reduced.columns(*STATIC)
    strain = modes.Z * (reduced.K @ modes.Z) / modes.omega2
    largest = np.argmax(strain, axis=0)
    kinetic = np.einsum("bbjj->jb", Mab)
    return [
        ModeInfo(
            j,
            "elastic",
            float(frequency),
            True,
            "",
            reduced.labels[largest[j]],
            float(strain[static, j].sum()),
            tuple(kinetic[j]),
        )
        for j, frequency in enumerate(modes.frequencies)
    ]
