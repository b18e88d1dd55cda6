"""Whether the parts of a model fit together: names, coordinates, functions, times, files.

In: a model, its flexible bodies that are reduced so far, and the entries that could not be read.
Out: all problems, with scene paths.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.materials import implausible_density
from flexmb.model import lookup
from flexmb.model.body import BodySpec
from flexmb.model.control import CHANNEL_SECTIONS, broken_channels, channel_problems
from flexmb.model.excitation import loads_beside_interfaces
from flexmb.model.flexible_body import FlexbodySpec, FlexibleBodySpec
from flexmb.model.forces.load import BodyLoadSpec
from flexmb.model.functions.discontinuities import first_discontinuities
from flexmb.model.functions.function import Function
from flexmb.model.joints.coupler import coupler_loop_problems
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.joint import lost_inertias
from flexmb.model.lookup import Bodies, Broken, ModelData, Scope
from flexmb.model.markers import MarkerSpec, place
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.plane import planar_problems
from flexmb.model.reading import GROUND, Spec
from flexmb.model.scenes.effects import effect_problems
from flexmb.model.scenes.supports import part_problems

_SAME_TIME = 1e-12  # times that differ by less than this fraction of the run are equal
_WITH_MARKERS = ("joints", "drivers", "forces", "sensors")
_WITH_FUNCTIONS = ("drivers", "forces", *CHANNEL_SECTIONS)


def model_problems(
    model: ModelData, flexbodies: Bodies, broken: Broken | None = None
) -> list[Problem]:
    """All problems of a model; see :meth:`Model.problems`."""
    scope = Scope(model, flexbodies, broken or {})
    problems = list(body_problems(scope))
    for section in ("joints", "couplers", "drivers", "forces", "sensors", "curves"):
        problems += _section_problems(scope, section)
    for part in (
        _twice_driven,
        channel_problems,
        _assembly_problems,
        _channel_names,
        view_problems,
    ):
        problems += part(scope)
    problems += [
        *_study_problems(scope),
        *_frequency_problems(scope),
        *_mode_problems(scope),
        *_time_problems(model),
        *part_problems(scope),
    ]
    problems += effect_problems(model)
    if not problems:  # what is in the plane is known of entries that hold together
        problems += planar_problems(scope)
    return problems


def model_warnings(model: ModelData, flexbodies: Bodies) -> Iterator[str]:
    """Sentences about what is probably a mistake."""
    yield from far_markers(model, flexbodies)
    yield from impact_warnings(model)
    yield from unlikely_densities(model)
    yield from idle_loads(model)
    yield from lost_inertias(model)


def _section_problems(scope: Scope, section: str) -> Iterator[Problem]:
    """The problems that each entry of a section reports of itself."""
    if section in _WITH_MARKERS:
        yield from scope.markers(section)
    specs, wrong = getattr(scope.model, section), False
    for name, spec in specs.items():
        for problem in spec.problems(scope, f"{section}.{name}"):
            wrong = True
            yield problem
    if section == "couplers" and specs and not wrong:
        yield from coupler_loop_problems(scope)


def _assembly_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of weights and guesses: bodies and joints that do not exist, guesses of driven
    joints."""
    spec = scope.model.assembly
    if spec is None:
        return
    for name in spec.weights:
        yield from scope.unknown(f"assembly.weights.{name}", "body", name, "bodies")
    driven = {
        (driver.joint, motion.coordinate): name
        for name, driver in scope.model.drivers.items()
        for motion in driver.motions(scope.model.plane)
        if driver.joint is not None
    }
    for joint, guess in spec.guess.items():
        where = f"assembly.guess.{joint}"
        if not scope.has("joints", joint):
            yield from scope.unknown(where, "joint", joint, "joints")
            continue
        for coordinate in guess.coordinates:
            yield from scope.coordinate(where, joint, coordinate)
            if (joint, coordinate) in driven:
                what = f'its {coordinate} is driven by "{driven[joint, coordinate]}": '
                what += "leave the guess out, the driver decides"
                yield Problem(f"{where}.{coordinate}", what)


def _channel_names(scope: Scope) -> Iterator[Problem]:
    """Problems of channel names in plots and known answers."""
    channels = (*scope.model.channels(), *scope.model.stress_channels())
    broken = broken_channels(scope)
    names = [(f"view.history[{i}]", name) for i, name in enumerate(scope.model.view.history)]
    names += [(f"check[{i}].sensor", check.sensor) for i, check in enumerate(scope.model.checks)]
    for where, name in names:
        if name not in channels and name.partition(".")[0] not in broken:
            yield Problem(where, f'unknown channel "{name}"', channels, nearest(name, channels))


def view_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of the bodies and markers named in [view]."""
    view = scope.model.view
    if view.follow is not None:
        yield from scope.unknown("view.follow", "body", view.follow, "bodies")
    for i, reference in enumerate(view.reference):
        if reference != "mean-axes":
            yield from scope.marker(f"view.reference[{i}]", reference)
    if view.layer is not None and view.color not in ("von_mises", "principal", "strain_energy"):
        what = f'the layer "{view.layer}" is of stress; give color = "von_mises" with it'
        yield Problem("view.layer", what)


def _study_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of the sensors or channels that a study uses."""
    study, broken = scope.model.study, broken_channels(scope)
    names = tuple(dict.fromkeys((*scope.model.sensors, *scope.model.channels())))
    for i, name in enumerate(study.sensors if study is not None else ()):
        if name not in names and name.partition(".")[0] not in broken:
            what = f'unknown sensor or channel "{name}"'
            yield Problem(f"study.sensors[{i}]", what, names, nearest(name, names))


def _frequency_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of bodies and interfaces in known natural frequencies."""
    all_bodies = scope.model.bodies.items()
    bodies = tuple(n for n, spec in all_bodies if isinstance(spec, FlexibleBodySpec))
    for i, check in enumerate(scope.model.frequency_checks):
        if check.body not in bodies:
            if check.body not in scope.broken.get("bodies", {}):
                what = f'there is no flexible body "{check.body}"'
                yield Problem(f"check[{i}].body", what, bodies, nearest(check.body, bodies))
            continue
        spec = scope.model.bodies[check.body]
        interfaces = tuple(spec.interfaces) if isinstance(spec, MeshBodySpec) else check.held
        for name in check.held:
            if name not in interfaces:
                what = f'{check.body} has no interface "{name}"'
                yield Problem(f"check[{i}].held", what, interfaces, nearest(name, interfaces))


def _mode_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of parameters in known linearised modes."""
    parameters = tuple(scope.model.parameters)
    for i, check in enumerate(scope.model.mode_checks):
        for name in check.parameters:
            if name not in parameters:
                where = f"check[{i}].parameters.{name}"
                yield Problem(where, "unknown parameter", parameters, nearest(name, parameters))


def _time_problems(model: ModelData) -> Iterator[Problem]:
    """Problems of times outside the run: known answers, pictures, outputs, tables."""
    specs = (model.dynamics, model.kinematics)
    spans = [spec.duration for spec in specs if spec is not None]
    spans += [model.statics.times[-1]] if model.statics is not None else []
    if spans:
        yield from _output_time_problems(model, max(spans))
        yield from _table_time_problems(model, max(spans))
        yield from _discontinuity_problems(model, max(spans))


def _output_time_problems(model: ModelData, duration: float) -> Iterator[Problem]:
    """Problems of times at which the results are read."""
    say, spec = model.units.say, model.dynamics
    times = [] if model.view.time is None else [("view.time", model.view.time)]
    times += [(f"check[{i}].time", check.time) for i, check in enumerate(model.checks)]
    listed = spec is not None and model.kinematics is None and isinstance(spec.outputs, tuple)
    first, last = (spec.outputs[0], spec.outputs[-1]) if listed else (0.0, duration)
    for where, time in times:
        if time > duration * (1 + _SAME_TIME):
            what = f"{say(time, 's')} lies after the end of the run, {say(duration, 's')}"
            yield Problem(where, what)
        elif listed and not first * (1 - _SAME_TIME) <= time <= last * (1 + _SAME_TIME):
            span = f"{say(first, 's')} to {say(last, 's')}"
            what = f"nothing is recorded at {say(time, 's')}: dynamics.outputs covers {span}"
            yield Problem(where, what)


def _table_time_problems(model: ModelData, duration: float) -> Iterator[Problem]:
    """Problems of splines and tables that have no values in a part of the run."""
    say = model.units.say
    cure = 'give more points, or say what holds outside them (beyond = "hold", '
    cure += '"extrapolate" or "repeat")'
    for section in _WITH_FUNCTIONS:
        for name, spec in getattr(model, section).items():
            for where, function in _functions(f"{section}.{name}", vars(spec)):
                first, last = _domain(function)
                if last < duration:
                    what = f"its points end at {say(last, 's')}, the run at {say(duration, 's')}"
                    yield Problem(where, f"{what}; {cure}")
                if first > 0.0:
                    what = f"its points begin at {say(first, 's')}, the run at 0"
                    yield Problem(where, f"{what}; {cure}")


def _discontinuity_problems(model: ModelData, duration: float) -> Iterator[Problem]:
    """Problems of functions without a value at some time of the run, and of displacements that
    jump."""
    say = model.units.say
    for where, function, spec in _time_functions(model):
        order = spec.order if isinstance(spec, DriverSpec) else 2
        text = function.expression.text
        text = "the function" if text.startswith("{") else f'"{text}"'
        for kind, time, _ in first_discontinuities(function.expression.ops, duration, 2 - order):
            if kind == "undefined" and time > 0.0:
                first, last = _domain(function)
                if first <= 0.0 and last >= duration:
                    what = f"{text} or a derivative that is needed is not finite at"
                    yield Problem(where, f"{what} t = {say(time, 's')}")
            elif kind == "value" and order == 0:
                what = f"{text} jumps at t = {say(time, 's')}: no force moves a body at once"
                curve, cure = function.curve, "let it rise by a step with a beginning and an end"
                if curve is not None and curve.period > 0.0:
                    cure = "it repeats, so that its last value must be its first one"
                yield Problem(where, f"{what}; {cure}")


def impact_warnings(model: ModelData) -> Iterator[str]:
    """Warnings of drivers whose velocity jumps."""
    if model.dynamics is None:
        return
    for where, function, spec in _time_functions(model):
        if not isinstance(spec, DriverSpec) or spec.order == 2:
            continue
        wanted = ("rate", "value")[spec.order]
        for kind, time, _ in first_discontinuities(
            function.expression.ops, model.dynamics.duration, 0
        ):
            if kind == wanted:
                text = function.expression.text
                what = "its points" if text.startswith("{") else f'"{text}"'
                yield (
                    f"{where}: the velocity of {what} jumps at "
                    f"t = {model.units.say(time, 's')}, an impact, whose impulse reactions do not "
                    "show; use a spline or a step without corners"
                )


def idle_loads(model: ModelData) -> Iterator[str]:
    """Warnings of body loads that no force applies in scenes that seem to expect it. Forces on
    nodes of a body on which something acts besides its interfaces are left out: they shape its
    modes."""
    if model.dynamics is None:
        return
    acting = {(f.body, f.load) for f in model.forces.values() if isinstance(f, BodyLoadSpec)}
    answered = {owner for _, owner, _ in loads_beside_interfaces(model)}
    for body, spec in model.bodies.items():
        for name, load in getattr(spec, "loads", {}).items():
            if (body, name) not in acting and (load.type != "force" or body not in answered):
                yield (
                    f"bodies.{body}.loads.{name}: adds its static response to the modes, but does "
                    'not act in a run without a force {type = "body-load", '
                    f'body = "{body}", load = "{name}", value = ...}} that says when'
                )


def unlikely_densities(model: ModelData) -> Iterator[str]:
    """Warnings of densities of rigid shapes that suggest a wrong unit; 1 is accepted as an
    example."""
    for name, spec in model.bodies.items():
        density: Any = getattr(getattr(spec, "material", None) or spec, "density", None)
        rigid = not spec.flexible and density is not None and density != 1.0
        if rigid and (sentence := implausible_density(density, slips_only=True)):
            yield f"bodies.{name}: {sentence}"


def _time_functions(model: ModelData) -> Iterator[tuple[str, Function, Any]]:
    """Functions of time without channels, with their paths and specifications."""
    for section in _WITH_FUNCTIONS:
        for name, spec in getattr(model, section).items():
            for where, function in _functions(f"{section}.{name}", vars(spec)):
                if not function.expression.channels:
                    yield where, function, spec


def _functions(where: str, value: Any) -> Iterator[tuple[str, Function]]:
    """The functions of time in the fields of a specification, with their paths."""
    if isinstance(value, Function):
        yield where, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _functions(f"{where}.{key}", item)
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _functions(f"{where}[{i}]", item)


def _domain(function: Function) -> tuple[float, float]:
    """Times [s] between which a function through points has values; infinite for other
    functions."""
    if (curve := function.curve) is None:
        return -np.inf, np.inf
    first = curve.knots[0] if np.isnan(curve.coefficients[0]).any() else -np.inf
    last = curve.knots[-1] if np.isnan(curve.coefficients[-1]).any() else np.inf
    return float(first), float(last)


_MAX_DISTANCE = 0.5  # largest plausible distance of a marker from its nodes, over the body's length


def body_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of the bodies and of ground."""
    if not scope.names("bodies"):
        yield Problem("bodies", "the model has no body: give at least one [bodies.NAME]")
    yield from _markers(scope, GROUND, GROUND, scope.model.ground.markers)
    for name, spec in scope.model.bodies.items():
        where = f"bodies.{name}"
        if name not in scope.flexbodies:
            yield from _files(scope, where, spec)
        yield from _markers(scope, where, name, spec.markers)
        yield from _initial(scope, where, name, spec)


def _initial(scope: Scope, where: str, body: str, spec: BodySpec) -> Iterator[Problem]:
    """Problems of initial velocities at markers that do not exist."""
    for name in spec.initial:
        missing = lookup.missing(scope.model, f"{body}.{name}", scope.flexbodies)
        if missing is not None:
            at = f"{where}.initial.{name}"
            yield Problem(at, missing.what, missing.allowed, missing.nearest)


def _files(scope: Scope, where: str, spec: BodySpec) -> Iterator[Problem]:
    key, source = "mesh", spec.mesh if isinstance(spec, MeshBodySpec) else None
    if isinstance(source, Spec):
        return
    if isinstance(spec, FlexbodySpec) and isinstance(spec.flexbody, str):
        key, source = "flexbody", spec.flexbody
    if source is None:
        return
    path = scope.model.path(source)
    if os.path.isdir(path):  # unlike Path.is_dir it answers for any name, however long
        yield Problem(f"{where}.{key}", f'"{source}" is a folder, not a file ({path})')
    elif not os.path.exists(path):
        yield Problem(f"{where}.{key}", f'no file "{source}" ({path})', (), _neighbours(path))


def _neighbours(path: Path) -> tuple[str, ...]:
    try:
        return nearest(path.name, sorted(entry.name for entry in path.parent.iterdir()))
    except OSError:
        return ()


def _markers(
    scope: Scope, where: str, body: str, markers: Mapping[str, MarkerSpec]
) -> Iterator[Problem]:
    taken = lookup.automatic_markers(scope.model, body, scope.flexbodies) if markers else ()
    spec = scope.model.bodies.get(body)
    for name, marker in markers.items():
        at = f"{where}.markers.{name}"
        if name in taken:
            yield Problem(at, f'the name "{name}" is taken by a marker that such a body has anyway')
        if spec is None or not spec.flexible:
            for key in ("node", "interface"):
                if getattr(marker, key) is not None:
                    yield Problem(f"{at}.{key}", "only a flexible body has one")
        elif lookup.has_all_markers(scope.model, body, scope.flexbodies):
            yield from _carrier(scope, at, body, marker)


def _carrier(scope: Scope, at: str, body: str, marker: MarkerSpec) -> Iterator[Problem]:
    taken = lookup.automatic_markers(scope.model, body, scope.flexbodies)
    names = tuple(name for name in taken if name != "origin")
    if marker.interface is not None and marker.interface not in names:
        what = f'the body has no interface "{marker.interface}"'
        yield Problem(f"{at}.interface", what, names, nearest(marker.interface, names))
        return
    flexbody = lookup.flexbody_of(scope.model, body, scope.flexbodies)
    if flexbody is not None:
        try:
            place(body, marker, flexbody)
        except FlexmbError as error:
            yield from (Problem(at, p.what, p.allowed, p.nearest) for p in error.problems)


def far_markers(model: ModelData, flexbodies: lookup.Bodies) -> Iterator[str]:
    """Warnings of markers that are far away from their flexible body."""
    for body, flexbody in flexbodies.items():
        spec = model.bodies.get(body)
        nodes = flexbody.nodes
        if spec is None or nodes is None or flexbody.m == 0:
            continue
        length = flexbody.characteristic_length
        for name, marker in spec.markers.items():
            if marker.position is None:
                continue
            away = np.linalg.norm(nodes.position - np.array(marker.position), axis=1).min()
            if away > _MAX_DISTANCE * length:
                away, long = (model.units.say(value, "m", 3) for value in (away, length))
                yield (
                    f"bodies.{body}.markers.{name}: lies {away} from the nearest node of a body "
                    f"about {long} long, as on a rigid arm; positions are in the scene's units"
                )


def _twice_driven(scope: Scope) -> Iterator[Problem]:
    """Problems of coordinates that two drivers prescribe."""
    driven: dict[tuple[str, ...], str] = {}
    for name, spec in scope.model.drivers.items():
        for coordinate, _ in spec.motions(scope.model.plane):
            target, key = _driven_coordinate(spec, coordinate)
            if key in driven:
                what = f'the {coordinate} {target} is driven by "{driven[key]}" already'
                yield Problem(f"drivers.{name}", what)
            driven.setdefault(key, name)


def _driven_coordinate(spec: DriverSpec, coordinate: str) -> tuple[str, tuple[str, ...]]:
    """What a driver prescribes: a text, and a key that is equal for equal coordinates."""
    if spec.joint is not None:
        return f'of joint "{spec.joint}"', ("joint", spec.joint, coordinate)
    if spec.between is not None:
        first, second = sorted(spec.between)
        return f'between "{first}" and "{second}"', ("between", first, second)
    first, second = spec.ends
    frame = f' relative to "{first}"' if spec.relative_to else ""
    return f'of marker "{second}"{frame}', ("marker", first, second, coordinate)
