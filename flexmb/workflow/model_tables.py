"""The tables that define a model: bodies, joints, drivers, force elements, initial values.

In: a model. Out: tables of text in its units, in the order and with the contents of the
"Definition of the model" sections of Hong & Liu 2011 (1.5, 2.5, 3.5): body frames and inertia,
joints with the body-fixed places and axes of their markers, drivers with their functions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from flexmb.model.reading import GROUND, Spec
from flexmb.workflow.listings import Table, scene_text

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model

Titled = tuple[str, Table]
_TABLES_OF_THEIR_OWN = ("bodies", "joints", "drivers", "sensors")  # or none


def definition_tables(model: Model, flexbodies: Mapping[str, FlexBody]) -> tuple[Titled, ...]:
    """All tables of a model that have rows, each with its title.

    Parameters
    ----------
    model : Model
        A valid model.
    flexbodies : mapping of str to FlexBody
        Its flexible bodies.
    """
    tables = (
        _places(model),
        _inertia(model, flexbodies),
        _joints(model),
        _markers(model, flexbodies),
        _drivers(model),
        *_other_elements(model),
        _velocities(model),
    )
    return tuple((title, table) for title, table in tables if table.rows)


def _places(model: Model) -> Titled:
    units = model.units
    rows = [
        (name, units.components(spec.position, "m"), units.components(spec.orientation, ""))
        for name, spec in model.bodies.items()
    ]
    columns = ("body", f"origin r [{units.label('m')}]", "Euler parameters, scalar first")
    return "bodies: frames in the placed pose, global axes", Table(columns, rows)


def _inertia(model: Model, flexbodies: Mapping[str, FlexBody]) -> Titled:
    units = model.units
    rows = []
    for name, spec in model.bodies.items():
        if spec.flexible and name not in flexbodies:
            continue
        if spec.flexible:
            body = flexbodies[name]
            mass, center, J, m = body.mass, body.center, body.inertia_about_center, str(body.m)
        else:
            of = spec.mass_properties  # type: ignore[attr-defined]
            mass, center, J, m = of.mass, of.center, of.inertia, ""
        products = (J[0, 1], J[0, 2], J[1, 2])
        rows.append(
            (
                name,
                f"{units.outward(mass, 'kg'):.6g}",
                units.components(center, "m"),
                units.components(J.diagonal(), "kg m^2"),
                units.components(products, "kg m^2", float(abs(J).max())),
                m,
            )
        )
    columns = (
        "body",
        f"mass [{units.label('kg')}]",
        f"centre [{units.label('m')}]",
        f"about it xx, yy, zz [{units.label('kg m^2')}]",
        "xy, xz, yz",
        "modes",
    )
    return "bodies: inertia, body axes", Table(columns, rows)


def _joints(model: Model) -> Titled:
    from flexmb.model.joints.joint import JOINT_TYPES

    rows = []
    for name, joint in model.joints.items():
        row = JOINT_TYPES[joint.type]
        count = row.equations if model.plane is None else row.planar_equations or 0
        axes = (model.units.components(axis or (), "") for axis in (joint.axis, joint.second_axis))
        rows.append((name, joint.type, *joint.between, str(count), *axes))
    columns = ("joint", "type", "marker I", "marker J", "equations", "axis", "second axis")
    return "joints: axes global, in the placed pose", Table(columns, rows)


def _markers(model: Model, flexbodies: Mapping[str, FlexBody]) -> Titled:
    """Both markers of every joint with their triads, as the equations use them."""
    from flexmb.engine.compile import compile_system

    compiled = compile_system(model, flexbodies)
    bodies = (*model.bodies, GROUND)  # the last for index -1
    rows = []
    for path, group in zip(compiled.layout.reactions, compiled.system.groups, strict=True):
        section, _, name = path.partition(".")
        first = compiled.system.rows[group["row"]]
        ends = "JI" if group["reversed"] else "IJ"  # the markers I and J of the joint in its rows
        for side, end in zip("IJ", ends, strict=True) if section == "joints" else ():
            marker = compiled.system.parts.markers[first[end]]
            axes = (model.units.components(marker["R"][:, k], "") for k in (0, 2))
            place = model.units.components(marker["rho"] + marker["arm"], "m")
            rows.append((name, side, bodies[marker["body"]], place, *axes))
    columns = ("joint", "", "body", f"place [{model.units.label('m')}]", "x axis", "z axis")
    return "markers of the joints, body axes", Table(columns, rows)


def _drivers(model: Model) -> Titled:
    rows = _entry_rows(model, model.drivers, "joint")
    return "drivers", Table(("driver", "joint", "coordinate = function of t"), rows)


def _other_elements(model: Model) -> Iterator[Titled]:
    """Forces, couplers and whatever else the model has by name, with the words of the scene."""
    for section, entries in vars(model).items():
        if section not in _TABLES_OF_THEIR_OWN and isinstance(entries, dict) and entries:
            rows = _entry_rows(model, entries, "type")
            yield section, Table((section.removesuffix("s"), "type", "values"), rows)


def _entry_rows(model: Model, entries: Mapping[str, Any], field: str) -> list[tuple[str, ...]]:
    """Name, one field and all others of each entry."""
    rows: list[tuple[str, ...]] = []
    for name, spec in entries.items():
        if isinstance(spec, Spec):
            words = spec.model_dump(mode="json", exclude_defaults=True, context=model.context)
            first = str(words.pop(field, ""))
            others = ", ".join(f"{key} = {scene_text(value)}" for key, value in words.items())
            rows.append((name, first, others))
    return rows


def _velocities(model: Model) -> Titled:
    units, rows = model.units, []
    for name, spec in model.bodies.items():
        for marker, initial in spec.initial_velocities.items():
            pairs = ((initial.velocity, "m/s"), (initial.angular_velocity, "rad/s"))
            cells = (units.components(vector or (), unit) for vector, unit in pairs)
            rows.append((f"{name}.{marker}", *cells, initial.axes))
    columns = (
        "marker",
        f"velocity [{units.label('m/s')}]",
        f"angular velocity [{units.label('rad/s')}]",
        "axes",
    )
    return "initial velocities requested", Table(columns, rows)
