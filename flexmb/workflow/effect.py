"""Effects of flexible bodies and of a scene, and the words that switch them.

Centrifugal softening is never looked at without geometric stiffening: of the two left out, neither
is judged alone (Padilla & von Flotow).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from flexmb import units
from flexmb.model.flexible_body import stretches
from flexmb.model.mesh_body import MeshBodySpec

if TYPE_CHECKING:
    from flexmb.analysis.effects.stored_motion import Motion
    from flexmb.engine.compile import Compiled
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model

DEFORMATION, VIBRATION = "deformation", "vibration"
STATIC = "vibration of quasi-static modes"
STIFFENING, COUPLING, BOTH = "geometric stiffening", "inertia coupling", "coupling and stiffening"
MODES, DAMPING, GRAVITY, FRICTION = "further modes", "damping", "gravity", "friction"
OUT_OF_PLANE, MEMBRANE = "motion out of the plane", "membrane forces"
RIGID, DYNAMIC = {"deformation": "rigid"}, {"deformation": "dynamic"}
QUASI_STATIC = {"deformation": "quasi-static"}
UNBOUNDED = 10.0  # share of a sensor above which no number is told
_MORE_MODES = 2  # times as many modes tell what those left out would do
FULL = {"inertia_coupling": "full", "geometric_stiffening": "full"}


_FRAMED = "quasi-static modes keep no momentum in a frame at an interface; take mean axes"
_STRETCHES = "quasi-static modes know no membrane forces"


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


def body_effects(
    model: Model, compiled: Compiled, motion: Motion, bodies: Mapping[str, FlexBody]
) -> Iterator[Effect]:
    """The effects of the flexible bodies of a run, body by body; `bodies` with all their data."""
    for name, spec in model.bodies.items():
        if spec.flexible:
            yield from _effects_of_body(name, spec, model, compiled, motion, bodies[name])


def _effects_of_body(
    name: str, spec: Any, model: Model, compiled: Compiled, motion: Motion, whole: FlexBody
) -> Iterator[Effect]:
    from flexmb.analysis.effects.contribution import indicators
    from flexmb.analysis.validity.linear_elasticity import LEAST_SPEED
    from flexmb.engine.ordering import quasi_static

    body = compiled.bodies[name]
    if body.m == 0:
        if whole.m or spec.deformation == "rigid":
            yield Effect(DEFORMATION, name, False, "rigid", DYNAMIC)
            yield Effect(VIBRATION, name, False, "rigid", DYNAMIC)
        return
    numbers = indicators(compiled, motion, body, name)
    yield Effect(DEFORMATION, name, True, f"u/L {numbers.deflection:.2g}", RIGID)
    fast, turning = f"f/f1 {numbers.excitation:.2g}", f"Ω/ω1 {numbers.speed:.2g}"
    if stretches(spec):
        yield Effect(VIBRATION, name, True, fast, QUASI_STATIC, _STRETCHES)
        yield Effect(MEMBRANE, name, True, "", {"membrane_forces": "none"})
    elif spec.deformation != "quasi-static":
        yield Effect(VIBRATION, name, True, fast, QUASI_STATIC)
        if static := quasi_static(spec, body, model):
            yield Effect(STATIC, name, False, f"{len(static)} of {body.m}", DYNAMIC)
    else:
        why = "" if spec.frame_interface is None else _FRAMED
        yield Effect(VIBRATION, name, False, fast, DYNAMIC, why)
    yield from _couplings(name, spec, body, whole, turning, numbers.speed < LEAST_SPEED)
    yield _modes(name, spec, body, whole)
    number = [one.name for one in compiled.layout.bodies].index(name)
    if compiled.system.parts.bodies["damped"][number]:
        yield Effect(DAMPING, name, True, "", {"damping": 0.0})


def _modes(name: str, spec: Any, body: FlexBody, whole: FlexBody) -> Effect:
    modes = f"{body.m} modes"
    if not isinstance(spec, MeshBodySpec) or spec.reduction in ("user", "guyan"):
        return Effect(MODES, name, False, modes, {}, "needs the mesh of the body")
    return Effect(MODES, name, False, modes, more_modes(whole, max(spec.mode_count, 4)))


def more_modes(body: FlexBody, count: int) -> dict[str, Any]:
    """Words that give a body more modes beside the static responses to inertia loads that it has.

    With enough modes "auto" takes no such responses, and what the body has is not among its shapes.
    """
    residual = body.provenance.get("residual", "none")
    return {"modes": _MORE_MODES * count, **({} if residual == "none" else {"residual": residual})}


def _couplings(
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


def percent(share: float | None) -> str:
    """A contribution as a text; empty where there is none."""
    if share is None or share > UNBOUNDED:
        return "" if share is None else "unbounded"
    return units.percent(share)
