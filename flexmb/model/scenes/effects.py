"""Effects of a whole scene that can be left out: ``[effects]``.

In: switches. Out: a model without the effects that are switched off; the engine's tables then do
not contain them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, TypeVar

from pydantic import StrictBool

from flexmb.errors import Problem
from flexmb.model.flexible_body import FlexibleBodySpec, stretches
from flexmb.model.forces.contact import ContactSpec
from flexmb.model.forces.force_characteristic import AnyStop
from flexmb.model.forces.friction import JointFrictionSpec
from flexmb.model.lookup import ModelData
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.quantities import Quantity
from flexmb.model.reading import Spec
from flexmb.model.sensor import ReactionSensorSpec

M = TypeVar("M", bound=ModelData)


class EffectsSpec(Spec):
    """Effects of the scene; each may be switched off by ``false``.

    ``choice = "auto"``, or ``effects = "auto"`` for short, selects those of flexible bodies such
    that what is left out changes no sensor by more than the share ``budget`` of its peak-to-peak.
    Switches: ``gravity``; ``friction`` in joints and contacts; ``contact``; ``stops``; ``planar``:
    false computes a scene with a ``plane`` in space.
    """

    choice: Literal["as stated", "auto"] = "as stated"
    budget: Annotated[float, Quantity("", "positive", (0.0, 1.0))] = 0.01
    gravity: StrictBool = True
    friction: StrictBool = True
    contact: StrictBool = True
    stops: StrictBool = True
    planar: StrictBool = True

    @property
    def absent(self) -> dict[str, type | tuple[type, ...]]:
        """Kinds of forces that each switch leaves out."""
        kinds = {"friction": JointFrictionSpec, "contact": ContactSpec, "stops": AnyStop}
        return {word: kind for word, kind in kinds.items() if not getattr(self, word)}


SWITCHES = ("gravity", "friction", "contact", "stops", "planar")
"""Effects of the whole scene."""


def effects_table(scene: Mapping[str, Any]) -> Any:
    """The table ``[effects]`` of a scene, also if it is a word with a ``budget`` next to it."""
    table = scene.get("effects", {})
    if isinstance(table, str):
        table = {"choice": table}
    if "budget" in scene and isinstance(table, Mapping):
        table = {**table, "budget": scene["budget"]}
    return table


def with_words(model: M, words: Mapping[str, Mapping[str, Any]]) -> M:
    """The model with other effect options of some bodies."""
    model = copy.copy(model)
    model.bodies = dict(model.bodies)
    for name, update in words.items():
        model.bodies[name] = model.bodies[name].model_copy(update=dict(update))
    return model


def active_model(model: M) -> M:
    """The model without the effects that are switched off; the same object if there are none."""
    effects = model.effects
    if effects is None or all(getattr(effects, word) for word in SWITCHES):
        return model
    active = copy.copy(model)
    active.effects = effects.model_copy(update=dict.fromkeys(SWITCHES, True))
    if not effects.gravity:
        active.gravity = None
    if not effects.planar:
        active.plane = None
    absent = tuple(effects.absent.values())
    active.forces = {k: spec for k, spec in model.forces.items() if not isinstance(spec, absent)}
    if not effects.friction:
        for name, spec in active.forces.items():
            if isinstance(spec, ContactSpec) and spec.friction is not None:
                active.forces[name] = spec.model_copy(update={"friction": None})
    return active


_PLAIN = ("rigid", "dynamic")
_BY_POSITIONS = ("coordinate-partitioning", "baumgarte")


def effect_problems(model: ModelData) -> Iterator[Problem]:
    """Problems of sensors of what is switched off, of quasi-static modes, and of automatic
    choices."""
    method = None if model.dynamics is None else model.dynamics.method
    for name, body in model.bodies.items():
        static = isinstance(body, FlexibleBodySpec) and body.deformation not in _PLAIN
        if static and method in _BY_POSITIONS:
            what = f"the method {method} knows no quasi-static modes: choose another method, or "
            yield Problem(f"bodies.{name}.deformation", what + '"dynamic"')
        if static and stretches(body):
            what = "quasi-static modes follow their loads by a constant stiffness, which membrane "
            what += 'forces change: make all modes "dynamic", or leave out membrane_forces'
            yield Problem(f"bodies.{name}.deformation", what)
        if stretches(body) and model.plane is not None and isinstance(body, MeshBodySpec):
            what = "a mesh of a planar scene is reduced in its plane, without the data for them: "
            what += "give the file of a body that was reduced in space"
            yield Problem(f"bodies.{name}.membrane_forces", what)
        elif stretches(body) and not getattr(body, "interfaces", True):
            what = "a body without interfaces has no data for them: give it one"
            yield Problem(f"bodies.{name}.membrane_forces", what)
    if model.effects is not None and model.effects.choice == "auto" and not model.channels():
        first = next(iter(model.bodies), "body")
        yield Problem(
            "effects",
            '"auto" needs a sensor to judge effects by; add one, such as [sensors.place] '
            f'type = "position" of = "{first}"',
        )
    for word, kind in ({} if model.effects is None else model.effects.absent).items():
        for name, sensor in model.sensors.items():
            force = sensor.force if isinstance(sensor, ReactionSensorSpec) else None
            if force is not None and isinstance(model.forces.get(force), kind):
                what = f"measures forces.{force}, which effects.{word} = false leaves out"
                yield Problem(f"sensors.{name}", f"{what}: remove the sensor")
