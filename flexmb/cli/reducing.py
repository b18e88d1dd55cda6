"""The command that makes flexible bodies, of a mesh file or of a scene's bodies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import show, words
from flexmb.cli.bars import Bars
from flexmb.cli.guard import FAILED_CHECK, guarded

__all__ = ["register"]

_MESH_ONLY = ("material", "units", "interface", "modes", "damping", "section", "plane", "stress")
_SCENE_ONLY = ("body", "set")


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(guarded(reduce))


def reduce(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MESH_OR_SCENE",
            help="Mesh file (Gmsh and others), or a scene (.toml) with flexible bodies.",
            show_default=False,
        ),
    ],
    material: Annotated[
        str | None,
        typer.Option(
            help="Name such as steel, or a table in SI: '{E = 70e9, nu = 0.33, density = 2700}'.",
            show_default=False,
        ),
    ] = None,
    units: Annotated[
        str | None, typer.Option(help="Unit system of the mesh: SI, mm-t-s, ...; SI by default.")
    ] = None,
    interface: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=GROUP",
            help="A mesh group where joints and loads attach, under the name of its marker; "
            "may be repeated. Without any, the modes of the free body are taken.",
        ),
    ] = None,
    modes: Annotated[
        int | None, typer.Option(help="Number of fixed-interface modes; 20 by default.")
    ] = None,
    damping: Annotated[
        float | None, typer.Option(help="Damping ratio of every mode; none by default.")
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
            "for planar scenes.",
        ),
    ] = None,
    stress: Annotated[
        str | None,
        typer.Option(help="Where the file keeps stress: surface (by default), all nodes, or none."),
    ] = None,
    body: Annotated[
        str | None, typer.Option(help="Only this flexible body of the scene.", show_default=False)
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            "-s",
            metavar="NAME=VALUE",
            help="A new value for a parameter or an entry of the scene; may be repeated.",
        ),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Reduce a scene's meshes anew, even if nothing changed.")
    ] = False,
    report: Annotated[
        bool, typer.Option("--report", help="Compare with the full model, and say how good it is.")
    ] = False,
    up_to: Annotated[
        float | None,
        typer.Option(
            "--up-to", metavar="HZ", help="Compare frequencies up to this one.", show_default=False
        ),
    ] = None,
    pictures: Annotated[
        bool, typer.Option("--pictures", help="Draw the first six modes beside the file.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File to write, <mesh>.flexbody.h5 here by default; of a scene the folder, "
            "out/<scene> by default.",
        ),
    ] = None,
) -> None:
    """Reduce a mesh, or the flexible bodies of a scene (Craig-Bampton modes).

    Prints mass, centre, inertia and a table of all modes: kept, or why dropped. A scene's known
    frequencies are checked. With --report the reduced body is compared with the full model.

    Example: flexmb reduce meshes/connecting_rod.msh --units mm-t-s --material steel
    --interface big_end=bore_big --interface small_end=bore_small --pictures
    """
    of_mesh = dict(
        zip(
            _MESH_ONLY,
            (material, units, interface, modes, damping, section, plane, stress),
            strict=True,
        )
    )
    of_scene = {"body": body, "set": overrides, "fresh": fresh}
    judged = {"report": report or up_to is not None, "up_to": up_to}
    if source.suffix == ".toml":
        _refuse(of_mesh, "belongs to a mesh file; a scene says it itself, or by --set")
        wanted = {"body": body, "fresh": fresh, "output": output, **judged}
        _reduce_scene(source, words.pairs(overrides or [], "--set"), wanted, pictures)
    else:
        _refuse(of_scene, "belongs to a scene (.toml)")
        if material is None:
            raise typer.BadParameter("is needed with a mesh file", param_hint="--material")
        _reduce_mesh(source, of_mesh, output, judged, pictures)


def _refuse(options: dict[str, Any], why: str) -> None:
    for name, given in options.items():
        if given:
            raise typer.BadParameter(why, param_hint=f"--{name}")


def _reduce_mesh(
    mesh: Path,
    given: dict[str, Any],
    output: Path | None,
    judged: dict[str, Any],
    pictures: bool,
) -> None:
    from flexmb import workflow

    options = {
        name: value
        for name in ("units", "modes", "damping", "plane", "stress")
        if (value := given[name]) is not None
    }
    with Bars() as progress:
        reduced = workflow.reduce_mesh(
            mesh,
            material=words.word_or_table(given["material"], "--material"),
            interfaces=words.pairs(given["interface"] or [], "--interface"),
            sections=words.tables(given["section"] or [], "--section"),
            output=output,
            progress=progress,
            **judged,
            **options,
        )
    _tell(reduced)
    _draw({reduced.body.name: reduced.path}, pictures)


def _reduce_scene(
    scene: Path, overrides: dict[str, str], wanted: dict[str, Any], pictures: bool
) -> None:
    from flexmb import workflow

    with Bars() as progress:
        found = workflow.reduce_scene(scene, overrides=overrides, progress=progress, **wanted)
    for reduced in found.bodies:
        _tell(reduced)
    for note in found.notes:
        show.line(f"note: {note}")
    if found.checks:
        show.checks(found.checks, "s")
    _draw({reduced.body.name: reduced.path for reduced in found.bodies}, pictures)
    if any(not outcome.passed for outcome in found.checks):
        raise typer.Exit(FAILED_CHECK)


def _tell(reduced: Any) -> None:
    """The body, how good it is, and its file."""
    show.flexible_body(reduced.body)
    if reduced.report is not None:
        show.quality(reduced.report)
    show.line(f"written: {reduced.path}")


def _draw(files: dict[str, Path], pictures: bool) -> None:
    if not pictures:
        return
    from flexmb.view import render_modes

    for path in files.values():
        picture = path.with_name(path.name.removesuffix(".h5").removesuffix(".flexbody"))
        show.line(f"written: {render_modes(path, output=picture.with_suffix('.modes.png'))}")
