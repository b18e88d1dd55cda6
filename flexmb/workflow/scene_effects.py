"""The effects of a scene as a whole: gravity, friction, contacts, stops, motion out of the plane.

Of contacts and stops that are left out, what they would have met along the computed motion is
measured in the scene that has them: how far coordinates travel beyond a stop, and with what force
bodies that overlap would be pushed apart.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array
from flexmb.model.forces.contact import ContactSpec
from flexmb.model.forces.force_characteristic import AnyStop, JointStopSpec
from flexmb.model.plane import plane_axes
from flexmb.model.scenes.effects import EffectsSpec, active_model
from flexmb.workflow.effect import FRICTION, GRAVITY, OUT_OF_PLANE, Effect
from flexmb.workflow.neighbours import ModelVariants

if TYPE_CHECKING:
    from flexmb.model import Model

_MEASURE = "audited_"
_STANDSTILL = 1e-6  # of the size of the model


def scene_effects(of: ModelVariants) -> Iterator[Effect]:
    """The effects of the scene, on or left out."""
    model, stated = of.model, of.model.effects or EffectsSpec()
    if any(model.gravity or ()):
        yield Effect(GRAVITY, "", stated.gravity, "", {"gravity": not stated.gravity})
    kinds = [(getattr(s, "type", ""), getattr(s, "friction", None)) for s in model.forces.values()]
    if any(kind == "joint-friction" or friction for kind, friction in kinds):
        yield Effect(FRICTION, "", stated.friction, "", {"friction": not stated.friction})
    for word, kind in (("contact", ContactSpec), ("stops", AnyStop)):
        specs = {name: s for name, s in model.forces.items() if isinstance(s, kind)}
        if specs:
            on, why, met = getattr(stated, word), "", None
            try:
                indicator, share, name = _largest(of, specs)
                met = (share, f"forces.{name}") if not on else None
            except FlexmbError as error:
                indicator, why = "", str(error).splitlines()[0]
            yield Effect(word, "", on, indicator, {word: not on}, why, met)
    if model.plane is not None and stated.planar:
        yield Effect(OUT_OF_PLANE, "", False, f"plane {model.plane}", {"planar": False})
    elif model.plane is not None:
        yield Effect(OUT_OF_PLANE, "", True, f"plane {model.plane}", direct=_off_plane(of))


def _off_plane(of: ModelVariants) -> tuple[float, str]:
    """How far bodies of a run in space leave the plane over the largest travel, or tilt [rad]."""
    from scipy.spatial.transform import Rotation  # takes 0.2 s

    normal, q, bodies = plane_axes(of.model.plane or "")[2], of.motion.q, of.compiled.layout.bodies
    travel = max(float(np.ptp(q[:, one.iq : one.iq + 3], axis=0).max()) for one in bodies)
    travel = max(travel, _STANDSTILL / of.compiled.system.weights.max())
    worst = 0.0, ""
    for body in bodies:
        e = np.roll(q[:, body.iq + 3 : body.iq + 7], -1, axis=1)
        axes = Rotation.from_quat(e).as_matrix()[:, normal]  # the normal in body axes
        tilt = float(np.linalg.norm(axes - axes[0], axis=1).max())
        share = max(tilt, float(np.ptp(q[:, body.iq + normal])) / travel)
        worst = max(worst, (share, f"bodies.{body.name}"))
    return worst


def _largest(of: ModelVariants, specs: Mapping[str, Any]) -> tuple[str, float, str]:
    """The contact or stop that is met most: in words, its share of the motion, its name.

    That is how far a coordinate travels beyond its stop, or bodies overlap, over the largest
    peak-to-peak of the coordinate or of the places of bodies.
    """
    measures = _measured(of, specs)
    places = [columns.iq for columns in of.compiled.layout.bodies]
    travel = max(float(np.ptp(of.motion.q[:, k : k + 3], axis=0).max()) for k in places)
    text, largest, worst = "never met", 0.0, ""
    for name, spec in specs.items():
        value = measures[name]
        if isinstance(spec, ContactSpec):
            force = float(np.linalg.norm(value, axis=1).max())
            beyond = (force / spec.stiffness) ** (1.0 / spec.exponent) if spec.stiffness else 0.0
            size, words = travel, f"{name} pushes with {of.model.units.say(force, 'N', 2)}"
            beyond = beyond if spec.stiffness or not force else travel
        else:
            low = -np.inf if spec.lower is None else spec.lower
            high = np.inf if spec.upper is None else spec.upper
            beyond = float(np.maximum(value[:, 0] - high, low - value[:, 0]).max().clip(0.0))
            turns = isinstance(spec, JointStopSpec) and "angle" in spec.coordinate
            size = float(np.ptp(value[:, 0]))
            words = f"{name} passed by {of.model.units.say(beyond, 'rad' if turns else 'm', 2)}"
        share = beyond / size if size > 0.0 else float(beyond > 0.0)
        if share > largest:
            text, largest, worst = words, share, name
    return text, largest, worst


def _measured(of: ModelVariants, specs: Mapping[str, Any]) -> dict[str, Array]:
    """(t, k) by name the coordinate of a stop, or the force of a contact, along the motion."""
    from flexmb.analysis.effects.stored_motion import carry_motion, equations_of
    from flexmb.engine.compile import compile_system

    model = copy.copy(of.model)
    stated = of.model.effects or EffectsSpec()
    model.effects = stated.model_copy(update={"contact": True, "stops": True})
    model = active_model(model)
    model.sensors = dict(model.sensors)
    for name, spec in specs.items():
        _add_measure(model, name, spec)
    other = compile_system(model, of.bodies)
    motion = of.motion
    wide = np.zeros((len(motion.t), len(other.layout.channels)))
    columns = {channel: k for k, channel in enumerate(other.layout.channels)}
    for k, channel in enumerate(of.compiled.layout.channels):
        wide[:, columns[channel]] = motion.channels[:, k]
    carried, _ = carry_motion(motion, of.compiled, other, {})
    still = np.zeros_like(carried.v)  # what is met by place alone, without damping and friction
    carried = replace(carried, channels=wide, v=still, vd=still)
    equations = equations_of(other)
    mine = {
        name: [k for channel, k in columns.items() if channel.split(".")[0] == _MEASURE + name]
        for name in specs
    }
    rows, measured = np.zeros((len(motion.t), len(columns))), sum(mine.values(), [])
    for k in range(len(motion.t)):
        wide[k, measured] = rows[k - 1, measured] if k else 0.0
        carried.put(k, equations)
        rows[k] = equations.channels()
    return {name: rows[:, places] for name, places in mine.items()}


def _add_measure(model: Model, name: str, spec: Any) -> None:
    """A sensor of what a contact or stop does."""
    if isinstance(spec, ContactSpec):
        model.add_sensor(_MEASURE + name, "reaction", force=name, axes="global")
    elif isinstance(spec, JointStopSpec):
        model.add_sensor(_MEASURE + name, spec.coordinate, joint=spec.joint)
    elif spec.axis is None:
        model.add_sensor(_MEASURE + name, "distance", between=spec.between)
    else:
        model.add_sensor(_MEASURE + name, "stroke", between=spec.between, axis=spec.axis)
