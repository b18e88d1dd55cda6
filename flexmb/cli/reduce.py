"""``flexmb reduce``: flexible bodies of a mesh file or of a scene, and what they hold."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    FAILED_CHECK,
    Overrides,
    command,
    output_option,
    parse_pairs,
    parse_table,
    refuse_options,
)
from flexmb.units import UnitSystem, unit_system


@command()
def reduce(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MESH_OR_SCENE",
            help="Mesh file (Gmsh and others), or a scene (.toml) with flexible bodies.",
        ),
    ],
    material: Annotated[
        str | None,
        typer.Option(
            help="Name such as steel, or a table in SI: '{E = 70e9, nu = 0.33, density = 2700}'."
        ),
    ] = None,
    units: Annotated[
        str | None, typer.Option(help="Unit system of the mesh: SI, mm-t-s, ...; SI by default.")
    ] = None,
    interface: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=GROUP",
            help="A mesh group where joints and loads attach, under the name of its marker, or a "
            "table as in a scene, lengths in m, such as 'a={center=[0, 0, 0], radius=0.02}'; may "
            "be repeated. Without any, the modes of the free body are taken.",
        ),
    ] = None,
    modes: Annotated[
        int | None, typer.Option(help="Number of fixed-interface modes; 20 by default.")
    ] = None,
    damping: Annotated[
        str | None,
        typer.Option(
            help="Damping ratio of every mode as a scene joins the body, adams, or a table; none "
            "by default."
        ),
    ] = None,
    stiffening: Annotated[
        str | None,
        typer.Option(
            "--geometric-stiffening",
            help="full: the stress by rotation and by forces at interfaces stiffens or softens "
            "the body; none by default.",
        ),
    ] = None,
    section: Annotated[
        list[str] | None,
        typer.Option(
            metavar="GROUP=TABLE",
            help="Section of the beams or shells of a mesh group (or all), with the words of a "
            "scene; may be repeated.",
        ),
    ] = None,
    plane: Annotated[
        str | None,
        typer.Option(
            help="xy, yz or zx of the mesh's frame: keep the modes in that plane alone, "
            "for planar scenes."
        ),
    ] = None,
    stress: Annotated[
        str | None,
        typer.Option(help="Where the file keeps stress: surface (by default), all nodes, or none."),
    ] = None,
    residual: Annotated[
        str | None,
        typer.Option(help="inertia: add the static responses to the body's own inertia loads."),
    ] = None,
    load_point: Annotated[
        list[int] | None,
        typer.Option(
            metavar="NODE",
            help="A node besides the interfaces at which loads act or, with geometric stiffening, "
            "sensors measure; may be repeated.",
        ),
    ] = None,
    body: Annotated[str | None, typer.Option(help="Only this flexible body of the scene.")] = None,
    overrides: Overrides = None,
    fresh: Annotated[
        bool,
        typer.Option("--fresh", help="Reduce a scene's meshes again, even if nothing changed."),
    ] = False,
    report: Annotated[
        bool, typer.Option("--report", help="Compare the bodies with their full models.")
    ] = False,
    up_to: Annotated[
        float | None, typer.Option(metavar="HZ", help="Compare frequencies up to this one.")
    ] = None,
    pictures: Annotated[
        bool, typer.Option("--pictures", help="Draw the first six modes into the same folder.")
    ] = False,
    output: Annotated[
        Path | None,
        output_option(
            "File to write, <mesh>.flexbody.h5 here by default; of a scene the folder, "
            "out/<scene> by default."
        ),
    ] = None,
) -> None:
    """Reduce a mesh, or the flexible bodies of a scene (Craig-Bampton modes).

    Prints mass, centre, inertia and a table of all modes: kept, or why dropped. A scene's known
    frequencies are checked. With --report the reduced body is compared with the full model.

    Example: flexmb reduce meshes/connecting_rod.msh --units mm-t-s --material steel
    --interface big_end=bore_big --interface small_end=bore_small --pictures
    """
    from flexmb.workflow import reduction

    options: dict[str, Any] = {
        "units": units,
        "modes": modes,
        "damping": _damping_value(damping),
        "plane": plane,
        "stress": stress,
        "geometric_stiffening": stiffening,
        "residual": residual,
    }
    of_mesh = {"material": material, "interface": interface, "section": section, **options}
    of_mesh["load-point"] = load_point
    quality: dict[str, Any] = {"report": report or up_to is not None, "up_to": up_to}
    notes, checks, scene_units = [], [], None
    if source.suffix == ".toml":
        refuse_options(of_mesh, "belongs to a mesh file; a scene says it itself, or by --set")
        with screen.Bars() as progress:
            scene = reduction.reduce_scene(
                source,
                overrides=parse_pairs(overrides, "--set"),
                progress=progress,
                body=body,
                fresh=fresh,
                output=output,
                **quality,
            )
        bodies, notes, checks = scene.bodies, scene.notes, scene.checks
        scene_units = scene.units
    else:
        from flexmb.fe.meshes.mesh_file import check_is_there

        of_scene = {"body": body, "set": overrides, "fresh": fresh}
        refuse_options(of_scene, "belongs to a scene (.toml)")
        if material is None:
            check_is_there(source)
            raise typer.BadParameter("is needed with a mesh file", param_hint="--material")
        sections = parse_pairs(section, "--section").items()
        ends = parse_pairs(interface, "--interface").items()
        with screen.Bars() as progress:
            reduced = reduction.reduce_mesh(
                source,
                material=parse_table(material, "--material"),
                interfaces={name: parse_table(text, "--interface") for name, text in ends},
                sections={group: parse_table(text, "--section") for group, text in sections},
                output=output,
                progress=progress,
                load_points=load_point or (),
                **quality,
                **{name: value for name, value in options.items() if value is not None},
            )
        bodies = (reduced,)
    _show_bodies(bodies, notes, checks, pictures, scene_units)
    if any(not outcome.passed for outcome in checks):
        raise typer.Exit(FAILED_CHECK)


def _show_bodies(
    bodies: Any, notes: list[str], checks: Any, pictures: bool, units: UnitSystem | None
) -> None:
    for reduced in bodies:
        show_body(reduced.body, units)
        if reduced.report is not None:
            _show_quality(reduced.report)
        screen.line(f"written: {reduced.path}")
    for note in notes:
        screen.line(f"note: {note}")
    if checks:
        screen.known_answers(checks, "s")
    for reduced in bodies if pictures else ():
        from flexmb.view.modes import render_modes

        screen.line(f"written: {render_modes(reduced.path, output=modes_picture(reduced.path))}")


def modes_picture(body: Path) -> Path:
    """The picture of the modes of a body, in the folder of its file."""
    stem = body.name.removesuffix(".h5").removesuffix(".flexbody")
    return body.with_name(f"{stem}.modes.png")


def show_body(body: Any, units: UnitSystem | None = None) -> None:
    """Show mass, centre, inertia, interfaces and modes of a flexible body.

    In the units of its scene, else of its mesh.
    """
    from flexmb.flexbody.body import MODE_COLUMNS, mode_table

    screen.heading(f"flexible body {body.name}")
    J = body.inertia_about_center
    units = units or unit_system(body.provenance.get("units", "SI"))

    def vector(values: Any, unit: str) -> str:
        text = units.components(values, unit, scale=1e-3)
        return f"({text}) {units.label(unit, raised=True)}"

    rows = [
        ("mass", units.say(body.mass, "kg")),
        ("centre of mass", vector(body.center, "m")),
        ("inertia about it xx, yy, zz", vector(J.diagonal(), "kg m^2")),
        ("inertia about it xy, xz, yz", vector(J[[0, 0, 1], [1, 2, 2]], "kg m^2")),
        ("modal coordinates", str(body.m)),
        ("damping", _damping_text(body)),
    ]
    if body.inertia_response is not None and body.m:
        shares = body.inertia_response.missing_shares
        motion = max(shares, key=shares.__getitem__, default="")
        lacks = f"{100 * shares[motion]:.3g} % missing under {motion}" if motion else "no response"
        rows += [("inertia loads", lacks)]
    rows += [(f"interface {i.name}", f"at {vector(i.position, 'm')}") for i in body.interfaces]
    rows += [("stress", _stress_text(body))]
    if body.section_forces is not None:
        rows += [("section forces", f"of {len(body.section_forces.elements)} beam elements")]
    rows += [
        (f"load {load.name}", f"{vector(load.force, 'N')}, work on the modes in the file")
        for load in body.loads
    ]
    screen.table(("", ""), rows)
    if body.modes:
        screen.table(MODE_COLUMNS, mode_table(body), right=(0, 2))


def _show_quality(report: Any) -> None:
    from flexmb.fe.reduction.quality_report import report_tables

    for part in report_tables(report):
        screen.heading(part.title)
        screen.table(part.columns, part.rows, right=range(1, len(part.columns)), whole=True)
        if part.note:
            screen.line(part.note)


def _damping_value(text: str | None) -> Any:
    try:
        return text if text is None else float(text)
    except ValueError:
        return parse_table(str(text), "--damping")


def _damping_text(body: Any) -> str:
    if body.damping is not None:
        return f"{body.damping.sentence()} in a scene"
    return "by a matrix" if body.D.any() else "none but that of a scene"


def _stress_text(body: Any) -> str:
    if body.stress is None:
        return "none"
    nodes = len(set(body.stress.ids.tolist()))
    inside = "" if body.nodes is None else f" of {len(body.nodes.ids)}"
    return f"at {nodes}{inside} nodes, in the layers {', '.join(body.stress.layers)}"
