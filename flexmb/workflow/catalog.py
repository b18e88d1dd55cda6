"""What there is to choose from: joints, forces, functions, materials and so on, as tables of text.

In: a topic. Out: a :class:`Listing`, read off the tables and specifications that the program itself
works with, so that nothing in it can be out of date.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.workflow import body_listings
from flexmb.workflow.listings import Listing, Table, fields_tables

__all__ = ["TOPICS", "Listing", "Table", "listing"]


def listing(topic: str) -> Listing:
    """Everything there is of a topic of ``TOPICS``.

    Raises
    ------
    FlexmbError
        No such topic; lists those there are, nearest first.
    """
    if topic not in TOPICS:
        names = tuple(TOPICS)
        what = f'there is nothing called "{topic}" to list'
        raise FlexmbError.from_problems([Problem("", what, names, nearest(topic, names))])
    return TOPICS[topic][1]()


def _joints() -> Listing:
    from flexmb.model.joints.joint import JOINT_TYPES, JointSpec

    rows = [
        (
            row.name,
            str(row.equations),
            "" if row.planar_equations is None else str(row.planar_equations),
            _free_motions(row.name, row.freedoms),
            ", ".join(row.coordinates),
            row.summary,
        )
        for row in JOINT_TYPES.values()
    ]
    columns = ("joint", "equations", "in a plane", "leaves free", "driver", "what it does")
    about = "z is the joint's axis, driver the coordinates that a driver can prescribe:"
    return Listing(
        "joints: [joints.name]",
        ((about, Table(columns, rows)), *fields_tables({"a joint": JointSpec})),
    )


def _curves() -> Listing:
    from flexmb.model.joints.curves import CurveSpec

    about = {"a curve, in the axes of the marker that carries it": CurveSpec}
    return Listing("curves that joints slide along: [curves.name]", fields_tables(about))


def _free_motions(joint: str, count: int) -> str:
    """What a joint leaves free, found from its rows: a row holds the motions that violate it."""
    from flexmb.engine.compile.joints.joint_rows import JOINT_ROWS
    from flexmb.engine.row_kinds import DOT1, DOT2, POINT

    slides, turns = set("xyz"), set("xyz")
    for kind, a, b, _ in JOINT_ROWS.get(joint, ()):
        if kind == POINT or (kind == DOT2 and a == b):
            slides.discard("xyz"[a])
        elif kind == DOT1:
            turns.discard("xyz"[3 - a - b])
    if len(slides) + len(turns) != count:
        return str(count)  # rows that hold no single motion of the axes
    told = [f"slide {', '.join(sorted(slides))}"] if slides else []
    told += [f"turn {', '.join(sorted(turns))}"] if turns else []
    return "; ".join(told) or "nothing"


def _couplers() -> Listing:
    from flexmb.model.joints.couplers import COUPLER_TYPES, AngleTerm, StrokeTerm

    about = "Each relates the coordinates of two or three joints by one equation:"
    terms = {"an angle in terms": AngleTerm, "a stroke in terms": StrokeTerm}
    return Listing(
        "couplers: [couplers.name]",
        ((about, Table((), [])), *fields_tables({**COUPLER_TYPES, **terms})),
    )


def _forces() -> Listing:
    from flexmb.model.forces.contacts import CONTACT_SHAPES
    from flexmb.model.forces.force import FORCE_TYPES
    from flexmb.model.forces.friction import FrictionSpec

    parts = {f"shape {name} of a contact": spec for name, spec in CONTACT_SHAPES.items()}
    parts["friction of a contact"] = FrictionSpec
    return Listing("forces: [forces.name]", fields_tables({**FORCE_TYPES, **parts}))


def _sensors() -> Listing:
    from flexmb.model.sensors.sensor import SENSOR_TYPES

    return Listing("sensors: [sensors.name]", fields_tables(SENSOR_TYPES))


def _controllers() -> Listing:
    from flexmb.model.sensors.states import CONTROLLER_TYPES, StateSpec

    kinds = {"a state: [states.name]": StateSpec, **CONTROLLER_TYPES}
    return Listing(
        "states and controllers: [states.name], [controllers.name]", fields_tables(kinds)
    )


def _shapes() -> Listing:
    from flexmb.model.bodies.mass_properties import SHAPES

    return Listing("shapes of rigid bodies: [bodies.name] shape = { ... }", fields_tables(SHAPES))


def _drivers() -> Listing:
    from flexmb.model.joints.drivers import DRIVEN, DriverSpec
    from flexmb.model.joints.joint import JOINT_TYPES

    rows = []
    for target, coordinates in DRIVEN.items():
        for name in coordinates:
            joints = ", ".join(j.name for j in JOINT_TYPES.values() if name in j.coordinates)
            rows.append((target, name, joints if target == "joint" else _DRIVEN_WORDS[name]))
    about = "Coordinates as functions of time; the multiplier is the actuator's force or torque:"
    return Listing(
        "drivers: [drivers.name]",
        ((about, Table(("driver of", "coordinate", "what it is, or joints that have it"), rows)),)
        + fields_tables({"a driver": DriverSpec}),
    )


_DRIVEN_WORDS = {
    "x": "place of the marker along x, global or of relative_to",
    "y": "place along y",
    "z": "place along z",
    "angle": "from x of relative_to (or ground) to x of the marker, about z or axis",
    "position": "x, y and z together, two of them in a plane: the path of a point",
    "distance": "length between two markers: the stroke of a cylinder without mass",
}


def _functions() -> Listing:
    from flexmb.model.functions.expression import CONSTANTS, FUNCTIONS
    from flexmb.model.functions.function import FUNCTION_FORMS

    known = [
        ("functions", ", ".join(written for _, written in FUNCTIONS.values())),
        ("constants", ", ".join(f"{name} = {value:.10g}" for name, value in CONSTANTS.items())),
        ("operators", "+ - * / ** and parentheses"),
    ]
    about = "A number, an expression in t and the parameters, or a named form. Expressions know:"
    named = 'Named forms, such as { type = "harmonic", amplitude = 2, frequency = 50 }:'
    return Listing(
        "functions of time t",
        ((about, Table(("", "in expressions"), known)), (named, Table((), [])))
        + fields_tables(FUNCTION_FORMS),
    )


def _methods() -> Listing:
    from flexmb.model.tasks.assembly import AssemblySpec, GuessSpec
    from flexmb.model.tasks.dynamics import DynamicsSpec
    from flexmb.model.tasks.kinematics import KinematicsSpec
    from flexmb.model.tasks.methods import METHODS

    rows = [(str(name), about) for name, about in METHODS.items()]
    kinds = {
        "[dynamics]": DynamicsSpec,
        "[kinematics]": KinematicsSpec,
        "[assembly]": AssemblySpec,
        "assembly.guess.joint": GuessSpec,
    }
    return Listing(
        "methods: dynamics.method",
        (("", Table(("method", "what it is"), rows)), *fields_tables(kinds)),
    )


def _units() -> Listing:
    from flexmb.units import UNIT_SYSTEMS

    rows = [
        (
            system.name,
            *(f"{value:.8g}" for value in (system.length, system.mass, system.time)),
            f"{system.factor(L=1, M=1, T=-2):.8g}",
            f"{system.factor(L=-1, M=1, T=-2):.8g}",
        )
        for system in UNIT_SYSTEMS.values()
    ]
    columns = ("system", "length [m]", "mass [kg]", "time [s]", "force [N]", "stress [Pa]")
    return Listing("unit systems", (("One unit of each, in SI:", Table(columns, rows)),))


def _cases() -> Listing:
    here = Path("cases")
    folder = here if here.is_dir() else Path(__file__).parents[2] / "cases"
    rows = [(path.as_posix(), _title(path)) for path in sorted(folder.glob("*/scene.toml"))]
    if not rows:
        about = "None here: the cases come with the sources, in the folder cases. See flexmb new."
        return Listing("cases", ((about, Table((), [])),))
    about = "Scenes with known answers; flexmb run runs one, flexmb reduce one without [dynamics]:"
    return Listing("cases", ((about, Table(("scene", "title"), rows)),))


def _title(path: Path) -> str:
    try:
        return str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))
    except (OSError, ValueError):
        return "cannot be read"


def _templates() -> Listing:
    from flexmb.workflow.templates import templates

    about = "Scenes to start from, written by flexmb new NAME --template TEMPLATE:"
    return Listing("templates", ((about, Table(("template", "title"), list(templates().items()))),))


TOPICS: dict[str, tuple[str, Callable[[], Listing]]] = {
    "joints": ("what they hold and leave free, which drivers they take", _joints),
    "couplers": ("gears, racks and linear relations of joint coordinates", _couplers),
    "curves": ("shapes that pins and cam followers slide along", _curves),
    "forces": ("forces, torques, springs and dampers", _forces),
    "drivers": ("coordinates of joints and markers as functions of time", _drivers),
    "functions": ("functions of time and what expressions know", _functions),
    "elements": ("finite elements of flexible bodies", body_listings.elements),
    "meshes": ("simple shapes that need no mesh file", body_listings.meshes),
    "sections": ("sections of beams, shells and solids", body_listings.sections),
    "reductions": (
        "how meshes become modes: methods, interfaces, ties, loads",
        body_listings.reductions,
    ),
    "methods": ("integrators and the settings of a run", _methods),
    "sensors": ("what a run can record", _sensors),
    "controllers": ("states with a rate, PID controllers, transfer functions", _controllers),
    "materials": ("built-in materials, their values and sources", body_listings.materials),
    "units": ("unit systems", _units),
    "shapes": ("shapes of rigid bodies", _shapes),
    "cases": ("example scenes with known answers", _cases),
    "templates": ("scenes to start from", _templates),
}
"""What can be listed: a few words on it, and what makes the listing."""
