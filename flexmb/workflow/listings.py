"""What a scene may contain: joints, forces, functions, materials and so on, as tables of text.

In: a topic. Out: a :class:`Listing`, read from the tables and specifications that the program
itself works with. Also the templates of scenes, which ``flexmb new`` copies.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flexmb.errors import FlexmbError, OutputError, Problem, nearest

_SCENE = "scene.toml"
_TEMPLATES = Path(__file__).parents[1] / "templates"
_SIMPLEST_TEMPLATE = "pendulum"


class Table(NamedTuple):
    """Rows of text under headings."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


class Listing(NamedTuple):
    """All entries of one topic: tables with a line of text above each."""

    title: str
    tables: tuple[tuple[str, Table], ...]


def listing(topic: str) -> Listing:
    """All entries of a topic of ``TOPICS``.

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


def templates() -> dict[str, str]:
    """The title of each template by its name."""
    return {path.parent.name: _title(path) for path in sorted(_TEMPLATES.glob(f"*/{_SCENE}"))}


def new_scene(folder: str | Path, template: str | None = None) -> Path:
    """Write a template, a scene that runs and its meshes, into a folder; the path of its scene.

    Parameters
    ----------
    folder : path
        Made if it is missing.
    template : str, optional
        A name of :func:`templates`; the simplest one by default.

    Raises
    ------
    FlexmbError
        No such template; lists those there are, nearest first.
    OutputError
        A file of the template is there already, or the folder cannot be written.
    """
    names, template = tuple(templates()), template or _SIMPLEST_TEMPLATE
    if template not in names:
        what = f'unknown template "{template}"'
        raise FlexmbError.from_problems([Problem("", what, names, nearest(template, names))])
    target = Path(folder)
    sources = sorted(path for path in (_TEMPLATES / template).iterdir() if path.is_file())
    present = [str(target / path.name) for path in sources if (target / path.name).exists()]
    if present:
        what = f"{', '.join(present)}: there already, and never overwritten; choose another name"
        raise OutputError(what)
    try:
        target.mkdir(parents=True, exist_ok=True)
        for path in sources:
            with (target / path.name).open("xb") as file:
                file.write(path.read_bytes())
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({error.strerror or error})") from None
    return target / _SCENE


def _title(path: Path) -> str:
    try:
        return str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))
    except (OSError, ValueError):
        return "cannot be read"


def _listing(
    title: str, kinds: Mapping[str, Any], about: str = "", table: Table | None = None
) -> Listing:
    """A text and a table, then one table of fields for each specification."""
    from flexmb.model import describe

    tables = [(about, table or Table((), []))] if about or table else []
    for spec in dict.fromkeys(kinds.values()):
        names = [name for name, kind in kinds.items() if kind is spec]
        text, fields = describe(spec)
        rows = [
            (
                field.name,
                field.words,
                "required" if field.required else _default_text(field.default),
            )
            for field in fields
            if field.name != "type" or field.form.get("enum", [None])[0] not in kinds
        ]
        columns = ("field", "holds", "default")
        tables.append((f"{', '.join(names)}: {text}", Table(columns, rows)))
    return Listing(title, tuple(tables))


def _default_text(default: Any) -> str:
    """A default as a scene writes it; empty for an optional entry without default."""
    if default is None or default == {} or default == ():
        return ""
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, Iterable) and not isinstance(default, str):
        return f"[{', '.join(_default_text(value) for value in default)}]"
    return f"{default:g}" if isinstance(default, int | float) else str(default)


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
    return _listing("joints: [joints.name]", {"a joint": JointSpec}, about, Table(columns, rows))


def _free_motions(joint: str, count: int) -> str:
    """The motions that a joint leaves free: each of its rows prevents one."""
    from flexmb.engine.joints.joint import JOINT_ROWS
    from flexmb.engine.row_kinds import DOT1, DOT2, POINT

    slides, turns = set("xyz"), set("xyz")
    for kind, a, b, _ in JOINT_ROWS.get(joint, ()):
        if kind == POINT or (kind == DOT2 and a == b):
            slides.discard("xyz"[a])
        elif kind == DOT1:
            turns.discard("xyz"[3 - a - b])
    if len(slides) + len(turns) != count:
        return str(count)  # rows that prevent no single motion of the axes
    motions = [f"slide {', '.join(sorted(slides))}"] if slides else []
    motions += [f"turn {', '.join(sorted(turns))}"] if turns else []
    return "; ".join(motions) or "nothing"


def _curves() -> Listing:
    from flexmb.model.joints.curve import CurveSpec

    kinds = {"a curve, in the axes of the marker that carries it": CurveSpec}
    return _listing("curves that joints slide along: [curves.name]", kinds)


def _couplers() -> Listing:
    from flexmb.model.joints.coupler import AngleTerm, StrokeTerm
    from flexmb.model.scenes.sections import COUPLER_TYPES

    terms = {"an angle in terms": AngleTerm, "a stroke in terms": StrokeTerm}
    about = "Each relates the coordinates of two or three joints by one equation:"
    return _listing("couplers: [couplers.name]", {**COUPLER_TYPES, **terms}, about)


def _forces() -> Listing:
    from flexmb.model.forces.contact import CONTACT_SHAPES
    from flexmb.model.forces.friction import FrictionSpec
    from flexmb.model.scenes.sections import FORCE_TYPES

    parts = {f"shape {name} of a contact": spec for name, spec in CONTACT_SHAPES.items()}
    parts["friction of a contact"] = FrictionSpec
    return _listing("forces: [forces.name]", {**FORCE_TYPES, **parts})


def _sensors() -> Listing:
    from flexmb.model.sensors.sensor import SENSOR_TYPES

    return _listing("sensors: [sensors.name]", SENSOR_TYPES)


def _controllers() -> Listing:
    from flexmb.model.scenes.sections import CONTROLLER_TYPES
    from flexmb.model.sensors.control import StateSpec

    kinds = {"a state: [states.name]": StateSpec, **CONTROLLER_TYPES}
    return _listing("states and controllers: [states.name], [controllers.name]", kinds)


def _shapes() -> Listing:
    from flexmb.model.bodies.mass_properties import SHAPES

    return _listing("shapes of rigid bodies: [bodies.name] shape = { ... }", SHAPES)


_MARKER_COORDINATES = {
    "x": "place of the marker along x, global or of relative_to",
    "y": "place along y",
    "z": "place along z",
    "angle": "from x of relative_to (or ground) to x of the marker, about z or axis",
    "position": "x, y and z together, two of them in a plane: the path of a point",
    "distance": "length between two markers: the stroke of a cylinder without mass",
}


def _drivers() -> Listing:
    from flexmb.model.joints.driver import DRIVEN, DriverSpec
    from flexmb.model.joints.joint import JOINT_TYPES

    rows = []
    for target, coordinates in DRIVEN.items():
        for name in coordinates:
            joints = ", ".join(j.name for j in JOINT_TYPES.values() if name in j.coordinates)
            rows.append((target, name, joints if target == "joint" else _MARKER_COORDINATES[name]))
    about = "Coordinates as functions of time; the multiplier is the actuator's force or torque:"
    table = Table(("driver of", "coordinate", "what it is, or joints that have it"), rows)
    return _listing("drivers: [drivers.name]", {"a driver": DriverSpec}, about, table)


def _functions() -> Listing:
    from flexmb.model.functions.expression import CONSTANTS, FUNCTIONS
    from flexmb.model.functions.function import FUNCTION_FORMS

    rows = [
        ("functions", ", ".join(text for _, text in FUNCTIONS.values())),
        ("constants", ", ".join(f"{name} = {value:.10g}" for name, value in CONSTANTS.items())),
        ("operators", "+ - * / ** and parentheses"),
    ]
    about = "A number, an expression in t and the parameters, or a named form. In expressions:"
    forms = 'Named forms, such as { type = "harmonic", amplitude = 2, frequency = 50 }:'
    tables = _listing("", FUNCTION_FORMS, forms).tables
    return Listing("functions of time t", ((about, Table(("", "in expressions"), rows)), *tables))


def _elements() -> Listing:
    from flexmb.fe import ELEMENTS

    about = (
        "Elements that make up a flexible body: solids always, surfaces and lines where a section "
        "names them (flexmb list sections); others only name groups:"
    )
    table = Table(("in the mesh", "what it is"), list(ELEMENTS.items()))
    return _listing("elements of flexible bodies", {}, about, table)


def _meshes() -> Listing:
    from flexmb.model.bodies.meshes import MESH_TYPES

    about = (
        'A mesh is a file, "rod.msh", or the table of a simple shape, such as '
        '{ type = "box", size = [1, 0.1, 0.1] }. Without divisions: along the longest edge 10 '
        "elements (20 of first order), along the others as many as make their edges as long, at "
        "least 2; around circles 16 (32):"
    )
    return _listing("meshes: [bodies.name] mesh = ...", MESH_TYPES, about)


def _sections() -> Listing:
    from flexmb.model.bodies.sections import SECTION_TYPES, LayerSpec, ReleasesSpec

    kinds = {**SECTION_TYPES, "a layer": LayerSpec, "releases": ReleasesSpec}
    about = "The section of each element group of a mesh; all takes what no other names:"
    return _listing("sections: [bodies.name] sections.group = { ... }", kinds, about)


def _reductions() -> Listing:
    from flexmb.model.bodies.interfaces import (
        LOAD_TYPES,
        InterfaceSpec,
        MassSpec,
        NodeSpringSpec,
        TieSpec,
    )
    from flexmb.model.bodies.mesh_body import METHODS, MeshBodySpec, ModesSpec

    kinds = {
        "a body": MeshBodySpec,
        "modes": ModesSpec,
        "an interface": InterfaceSpec,
        "a tie": TieSpec,
        "a mass": MassSpec,
        "a spring": NodeSpringSpec,
        **LOAD_TYPES,
    }
    table = Table(("reduction", "what it keeps"), list(METHODS.items()))
    about = "How the mesh of a flexible body becomes modes:"
    return _listing("flexible bodies: [bodies.name]", kinds, about, table)


def _methods() -> Listing:
    from flexmb.model.tasks.dynamics import METHODS, DynamicsSpec
    from flexmb.model.tasks.kinematics import AssemblySpec, GuessSpec, KinematicsSpec

    kinds = {
        "[dynamics]": DynamicsSpec,
        "[kinematics]": KinematicsSpec,
        "[assembly]": AssemblySpec,
        "assembly.guess.joint": GuessSpec,
    }
    rows = [(str(name), about) for name, about in METHODS.items()]
    return _listing("methods: dynamics.method", kinds, "", Table(("method", "what it is"), rows))


def _materials() -> Listing:
    from flexmb.materials import COLUMNS, table
    from flexmb.model.bodies.material import MATERIAL_KINDS

    about = "Linear elastic and isotropic; typical values, give your own where grades matter:"
    return _listing("materials", MATERIAL_KINDS, about, Table(COLUMNS, table()))


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
    return _listing("unit systems", {}, "One unit of each, in SI:", Table(columns, rows))


def _cases() -> Listing:
    here = Path("cases")
    folder = here if here.is_dir() else Path(__file__).parents[2] / "cases"
    rows = [(path.as_posix(), _title(path)) for path in sorted(folder.glob(f"*/{_SCENE}"))]
    if not rows:
        about = "None here: the cases are in the folder cases of the sources. See flexmb new."
        return _listing("cases", {}, about)
    about = "Scenes with known answers; flexmb run runs one, flexmb reduce one without [dynamics]:"
    return _listing("cases", {}, about, Table(("scene", "title"), rows))


def _templates() -> Listing:
    about = "Scenes to start from, written by flexmb new NAME --template TEMPLATE:"
    table = Table(("template", "title"), list(templates().items()))
    return _listing("templates", {}, about, table)


TOPICS: dict[str, tuple[str, Callable[[], Listing]]] = {
    "joints": ("what they constrain and leave free, which drivers they take", _joints),
    "couplers": ("gears, racks and linear relations of joint coordinates", _couplers),
    "curves": ("shapes that pins and cam followers slide along", _curves),
    "forces": ("forces, torques, springs and dampers", _forces),
    "drivers": ("coordinates of joints and markers as functions of time", _drivers),
    "functions": ("functions of time and of measures, and expressions", _functions),
    "elements": ("finite elements of flexible bodies", _elements),
    "meshes": ("simple shapes that need no mesh file", _meshes),
    "sections": ("sections of beams, shells and solids", _sections),
    "reductions": ("how meshes become modes: methods, interfaces, ties, loads", _reductions),
    "methods": ("integrators and the settings of a run", _methods),
    "sensors": ("what a run can record", _sensors),
    "controllers": ("states with a rate, PID controllers, transfer functions", _controllers),
    "materials": ("built-in materials, their values and sources", _materials),
    "units": ("unit systems", _units),
    "shapes": ("shapes of rigid bodies", _shapes),
    "cases": ("example scenes with known answers", _cases),
    "templates": ("scenes to start from", _templates),
}
"""Topics: a few words on each, and the function that makes its listing."""
