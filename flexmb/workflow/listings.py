"""What a scene may contain: joints, forces, functions, materials and so on, as tables of text.

In: a topic. Out: a :class:`Listing`, read from the tables and specifications that the program
itself works with. Also the templates of scenes, which ``flexmb new`` copies.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flexmb.errors import FlexmbError, OutputError
from flexmb.flexbody.mesh_options import REDUCTIONS, MassOptions, NodeSpringOptions, TieOptions
from flexmb.flexbody.part_options import SUPPORTS, FrequenciesOptions, SupportOptions
from flexmb.flexbody.section_options import LayerOptions, ReleasesOptions
from flexmb.materials import COLUMNS
from flexmb.materials import table as material_rows
from flexmb.model import describe
from flexmb.model.body import SHAPES
from flexmb.model.control import StateSpec
from flexmb.model.forces.contact import CONTACT_SHAPES
from flexmb.model.forces.friction import FrictionSpec
from flexmb.model.functions.expression import CONSTANTS, FUNCTIONS
from flexmb.model.functions.function import FUNCTION_FORMS
from flexmb.model.joints.coupler import AngleTerm, StrokeTerm
from flexmb.model.joints.curve import CurveSpec
from flexmb.model.joints.driver import DRIVEN, DriverSpec
from flexmb.model.joints.joint import JOINT_TYPES, JointSpec
from flexmb.model.mesh_body import (
    LOAD_TYPES,
    MESH_TYPES,
    SECTION_TYPES,
    InterfaceSpec,
    MeshBodySpec,
    ModesSpec,
)
from flexmb.model.option_specs import DAMPING_KINDS, MATERIAL_KINDS, spec_of
from flexmb.model.reading import Spec
from flexmb.model.scenes.dynamics import (
    METHODS,
    AssemblySpec,
    DynamicsSpec,
    GuessSpec,
    KinematicsSpec,
    StaticsSpec,
    ValiditySpec,
)
from flexmb.model.scenes.sections import CONTROLLER_TYPES, COUPLER_TYPES, FORCE_TYPES, ViewSpec
from flexmb.model.scenes.supports import PART_LOAD_TYPES, PartSpec
from flexmb.model.sensor import SENSOR_TYPES
from flexmb.units import UNIT_SYSTEMS

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


class Topic(NamedTuple):
    """What can be listed: a few words on it, the specifications, a text and a table above them."""

    words: str
    title: str
    kinds: Mapping[str, type[Spec]]
    about: str = ""
    table: Callable[[], Table] = lambda: Table((), [])


def _of_entry(entry: str, about: str, table: Table) -> tuple[str, Table]:
    """A table whose heading has a word, or its rows whose name has it."""
    if entry.lower() in about.partition(":")[0].lower():
        return about, table
    return about, Table(
        table.columns, [row for row in table.rows if entry.lower() in row[0].lower()]
    )


def listing(topic: str, entry: str | None = None) -> Listing:
    """All entries of a topic of ``TOPICS``: its own table, a table of fields of each kind.

    Parameters
    ----------
    topic : str
        One of ``TOPICS``.
    entry : str, optional
        A word of the names of those entries that are wanted.

    Raises
    ------
    FlexmbError
        No such topic or entry; lists those there are, nearest first.
    """
    if topic not in TOPICS:
        raise FlexmbError.unknown_name("topic of a list", topic, TOPICS)
    _, title, kinds, about, table = TOPICS[topic]
    own = table()
    tables = [(about, own)] if about or own.rows else []
    for spec in dict.fromkeys(kinds.values()):
        names = [name for name, kind in kinds.items() if kind is spec]
        text, fields = describe(spec)
        rows = [
            (f.name, f.words, "required" if f.required else shown)
            for f in fields
            for shown in ["" if f.default in (None, {}, ()) else scene_text(f.default)]
            if f.name != "type" or f.form.get("enum", [None])[0] not in kinds
        ]
        tables.append((f"{', '.join(names)}: {text}", Table(("field", "holds", "default"), rows)))
    if entry is not None:
        parts = [_of_entry(entry, *part) for part in tables]
        tables = [part for part in parts if part[1].rows]
        if not tables:
            names = [*kinds, *(row[0] for row in own.rows if row[0])]
            raise FlexmbError.unknown_name(f"entry of {topic}", entry, names)
    return Listing(title, tuple(tables))


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
        A name of :func:`templates`; by default the one with the name of the folder, or the
        simplest one.

    Raises
    ------
    FlexmbError
        No such template; lists those there are, nearest first.
    OutputError
        A file of the template is there already, or the folder cannot be written.
    """
    names, target = tuple(templates()), Path(folder)
    template = template or (target.name if target.name in names else _SIMPLEST_TEMPLATE)
    if template not in names:
        raise FlexmbError.unknown_name("template", template, names)
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


def scene_text(value: Any) -> str:
    """A value as a scene writes it, numbers with six digits."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {scene_text(item)}' for key, item in value.items())} }}"
    if isinstance(value, Iterable) and not isinstance(value, str):
        return f"[{', '.join(scene_text(item) for item in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _joint_table() -> Table:
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
    return Table(columns, rows)


def _free_motions(joint: str, count: int) -> str:
    """The motions that a joint leaves free: each of its rows prevents one."""
    from flexmb.engine.joints import DOT1, DOT2, POINT
    from flexmb.engine.joints.joint import JOINT_ROWS

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


_MARKER_COORDINATES = {
    "x": "place of the marker along x, global or of relative_to",
    "y": "place along y",
    "z": "place along z",
    "angle": "from x of relative_to (or ground) to x of the marker, about z or axis",
    "position": "x, y and z together, two of them in a plane: the path of a point",
    "distance": "length between two markers: the stroke of a cylinder without mass",
}


def _driver_table() -> Table:
    rows = []
    for target, coordinates in DRIVEN.items():
        for name in coordinates:
            joints = ", ".join(j.name for j in JOINT_TYPES.values() if name in j.coordinates)
            rows.append((target, name, joints if target == "joint" else _MARKER_COORDINATES[name]))
    return Table(("driver of", "coordinate", "what it is, or joints that have it"), rows)


def _expression_table() -> Table:
    rows = [
        ("functions", ", ".join(text for _, text in FUNCTIONS.values())),
        ("constants", ", ".join(f"{name} = {value:.10g}" for name, value in CONSTANTS.items())),
        ("operators", "+ - * / ** and parentheses"),
    ]
    return Table(("", "in expressions"), rows)


def _element_table() -> Table:
    from flexmb.fe.elements.element_blocks import ELEMENTS

    return Table(("in the mesh", "what it is"), list(ELEMENTS.items()))


def _unit_table() -> Table:
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
    return Table(columns, rows)


def _case_table() -> Table:
    here = Path("cases")
    folder = here if here.is_dir() else Path(__file__).parents[2] / "cases"
    rows = [(path.as_posix(), _title(path)) for path in sorted(folder.glob(f"*/{_SCENE}"))]
    return Table(("scene", "title"), rows)


TOPICS = {
    "joints": Topic(
        "what they constrain and leave free, which drivers they take",
        "joints: [joints.name]",
        {"a joint": JointSpec},
        "z is the joint's axis, driver the coordinates that a driver can prescribe:",
        _joint_table,
    ),
    "couplers": Topic(
        "gears, racks and linear relations of joint coordinates",
        "couplers: [couplers.name]",
        {**COUPLER_TYPES, "an angle in terms": AngleTerm, "a stroke in terms": StrokeTerm},
        "Each relates the coordinates of two or three joints by one equation:",
    ),
    "curves": Topic(
        "shapes that pins and cam followers slide along",
        "curves that joints slide along: [curves.name]",
        {"a curve, in the axes of the marker that carries it": CurveSpec},
    ),
    "forces": Topic(
        "forces, torques, springs and dampers",
        "forces: [forces.name]",
        {
            **FORCE_TYPES,
            **{f"shape {name} of a contact": spec for name, spec in CONTACT_SHAPES.items()},
            "friction of a contact": FrictionSpec,
        },
    ),
    "drivers": Topic(
        "coordinates of joints and markers as functions of time",
        "drivers: [drivers.name]",
        {"a driver": DriverSpec},
        "Coordinates as functions of time; the multiplier is the actuator's force or torque:",
        _driver_table,
    ),
    "functions": Topic(
        "functions of time and of measures, and expressions",
        "functions of time t",
        FUNCTION_FORMS,
        "A number, an expression in t and the parameters, or a named form such as "
        '{ type = "harmonic", amplitude = 2, frequency = 50 }. In expressions:',
        _expression_table,
    ),
    "elements": Topic(
        "finite elements of flexible bodies",
        "elements of flexible bodies",
        {},
        "Elements that make up a flexible body: solids always, surfaces and lines where a section "
        "names them (flexmb list sections); others only name groups:",
        _element_table,
    ),
    "meshes": Topic(
        "simple shapes that need no mesh file",
        "meshes: [bodies.name] mesh = ...",
        MESH_TYPES,
        'A mesh is a file, "rod.msh", or the table of a simple shape, such as '
        '{ type = "box", size = [1, 0.1, 0.1] }. Without divisions: along the longest edge 10 '
        "elements (20 of first order), along the others as many as make their edges as long, at "
        "least 2; around circles 16 (32):",
    ),
    "sections": Topic(
        "sections of beams, shells and solids",
        "sections: [bodies.name] sections.group = { ... }",
        {**SECTION_TYPES, "a layer": spec_of(LayerOptions), "releases": spec_of(ReleasesOptions)},
        "The section of each element group of a mesh; all takes what no other names:",
    ),
    "reductions": Topic(
        "how meshes become modes: methods, interfaces, ties, loads",
        "flexible bodies: [bodies.name]",
        {
            "a body": MeshBodySpec,
            "modes": ModesSpec,
            **DAMPING_KINDS,
            "an interface": InterfaceSpec,
            "a tie": spec_of(TieOptions),
            "a mass": spec_of(MassOptions),
            "a spring": spec_of(NodeSpringOptions),
            **LOAD_TYPES,
        },
        "How the mesh of a flexible body becomes modes:",
        lambda: Table(("reduction", "what it keeps"), list(REDUCTIONS.items())),
    ),
    "parts": Topic(
        "a body by itself: supports, loads, frequencies, buckling",
        "a part by itself: [part]",
        {
            "[part]": PartSpec,
            "a support": spec_of(SupportOptions),
            "frequencies": spec_of(FrequenciesOptions),
            **{name: PART_LOAD_TYPES[name] for name in ("interface", "spin")},
        },
        "What a support holds; loads of a part are those of a body, and at an interface, and spin:",
        lambda: Table(("support", "what it holds"), list(SUPPORTS.items())),
    ),
    "methods": Topic(
        "integrators and the settings of a run",
        "methods: dynamics.method",
        {
            "[dynamics]": DynamicsSpec,
            "[kinematics]": KinematicsSpec,
            "[statics]": StaticsSpec,
            "[assembly]": AssemblySpec,
            "assembly.guess.joint": GuessSpec,
            "[validity]": ValiditySpec,
        },
        "",
        lambda: Table(("method", "what it is"), [(str(k), v) for k, v in METHODS.items()]),
    ),
    "sensors": Topic("what a run can record", "sensors: [sensors.name]", SENSOR_TYPES),
    "controllers": Topic(
        "states with a rate, PID controllers, transfer functions",
        "states and controllers: [states.name], [controllers.name]",
        {"a state: [states.name]": StateSpec, **CONTROLLER_TYPES},
    ),
    "materials": Topic(
        "built-in materials, their values and sources",
        "materials",
        MATERIAL_KINDS,
        "Linear elastic and isotropic; typical values, give your own where grades matter:",
        lambda: Table(COLUMNS, material_rows()),
    ),
    "units": Topic("unit systems", "unit systems", {}, "One unit of each, in SI:", _unit_table),
    "view": Topic(
        "what pictures and films show",
        "pictures and films: [view], flexmb render and film --view WORD=VALUE, render(**words)",
        {"a view": ViewSpec},
    ),
    "shapes": Topic(
        "shapes of rigid bodies", "shapes of rigid bodies: [bodies.name] shape = { ... }", SHAPES
    ),
    "cases": Topic(
        "example scenes with known answers",
        "cases",
        {},
        "Scenes with known answers, in the folder cases of the sources; flexmb run runs one, "
        "flexmb reduce one without [dynamics]:",
        _case_table,
    ),
    "templates": Topic(
        "scenes to start from",
        "templates",
        {},
        "Scenes to start from, written by flexmb new NAME --template TEMPLATE:",
        lambda: Table(("template", "title"), list(templates().items())),
    ),
}
"""All that can be listed."""
