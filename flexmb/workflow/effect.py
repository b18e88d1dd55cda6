"""An effect of a flexible body or of a scene, and the words that switch it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from flexmb.flexbody import FlexBody
from flexmb.model.mesh_body import MeshBodySpec

DEFORMATION, VIBRATION = "deformation", "vibration"
STATIC = "vibration of quasi-static modes"
STIFFENING, COUPLING, BOTH = "geometric stiffening", "inertia coupling", "coupling and stiffening"
MODES, DAMPING, GRAVITY, FRICTION = "further modes", "damping", "gravity", "friction"
OUT_OF_PLANE = "motion out of the plane"
FULL = {"inertia_coupling": "full", "geometric_stiffening": "full"}


@dataclass(frozen=True)
class Effect:
    """An effect of a body, or of the scene, and the words that switch it over.

    `why` says what an estimate would need, where there can be none. `direct` is its share and where
    that is, where the computed motion says it by itself.
    """

    name: str
    body: str
    on: bool
    indicator: str
    words: Mapping[str, Any] = field(default_factory=dict)
    why: str = ""
    direct: tuple[float, str] | None = None


def couplings(
    name: str, spec: Any, body: FlexBody, whole: FlexBody, turning: str, slow: bool
) -> Iterator[Effect]:
    """Inertia coupling and geometric stiffening; coupling alone where rotation is too slow for
    stiffening, and there is no data for that. `whole` is the body with all the data of its file."""
    stiffened = body.centrifugal_stiffness is not None
    constant = spec.inertia_coupling == "constant"
    has_data = whole.centrifugal_stiffness is not None
    why = ""
    if not stiffened and not has_data and not isinstance(spec, MeshBodySpec):
        why = "the body file has no data for it: "
        why += (
            "flexmb reduce with --geometric-stiffening full"
            if whole.provenance
            else "give centrifugal_stiffness with its arrays, and the bend of its interfaces"
        )
    none = {"inertia_coupling": "constant", "geometric_stiffening": "none"}
    if constant and not stiffened:
        if why and slow:
            yield Effect(COUPLING, name, False, turning, {"inertia_coupling": "full"})
            yield Effect(STIFFENING, name, False, turning, FULL, why)
        else:
            yield Effect(BOTH, name, False, turning, FULL, why)
        return
    if not stiffened:
        yield Effect(COUPLING, name, True, turning, {"inertia_coupling": "constant"})
        yield Effect(STIFFENING, name, False, turning, {"geometric_stiffening": "full"}, why)
    else:
        yield Effect(BOTH, name, not constant, turning, FULL if constant else none)
    if spec.inertia_coupling == "partial":
        yield Effect(f"full {COUPLING}", name, False, turning, {"inertia_coupling": "full"})
    elif not constant:
        yield Effect(f"full {COUPLING}", name, True, turning, {"inertia_coupling": "partial"})
