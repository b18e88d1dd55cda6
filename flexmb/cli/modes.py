"""``flexmb modes``, ``response``, ``statics``: linearised modes, responses, equilibria."""

from __future__ import annotations

from cmath import isfinite, phase
from collections.abc import Sequence
from math import degrees, inf, isnan, pi
from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    Overrides,
    Scene,
    command,
    output_option,
    parse_names,
    parse_pairs,
    refuse_options,
)
from flexmb.errors import FlexmbError, SceneError

_BODIES = 3  # that are named for a mode
_LEAST_SHARE = 0.05
_SHOWN_FREQUENCIES = 20
_MAX_PICTURES = 6
_ROUND_OFF = 1e-12  # of the largest value of an equilibrium
_SHOWN = 6  # channels in the table of equilibria
_ENDINGS = (".png", ".pdf", ".svg")


@command()
def modes(
    source: Annotated[Path, typer.Argument(help="Scene file (TOML), result file or its folder.")],
    time: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Of a result: the output nearest to this time, such as 0.1 or '100 ms'; its end "
            "by default.",
        ),
    ] = None,
    about: Annotated[
        str,
        typer.Option(
            help="Of a scene, its first state: quasi-static, flexible bodies in elastic "
            "equilibrium with loads and motion; undeformed; or initial, as [dynamics] starts; "
            "or static: the equilibrium of the whole machine."
        ),
    ] = "quasi-static",
    frame: Annotated[
        str,
        typer.Option(
            help="Whose axes the motion is written in: a body that turns, or auto: where it is "
            "steady. ground: the same as the ground sees it, with forward and backward whirl."
        ),
    ] = "auto",
    count: Annotated[int, typer.Option(help="How many modes are shown.", min=1)] = 12,
    vary: Annotated[
        str | None,
        typer.Option(
            "--vary",
            "-v",
            metavar="NAME=VALUES",
            help="Of a scene: a parameter or an entry by its path, with values 0,10,20 or "
            "0..100:11 (eleven at equal distances).",
        ),
    ] = None,
    overrides: Overrides = None,
    output: Annotated[
        Path | None, output_option("With --vary: the Campbell diagram (.png, .pdf, .svg).")
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Draw the modes that are shown, up to six, each displaced by it."
        ),
    ] = None,
    root_locus: Annotated[Path | None, typer.Option(help="With --vary: the root locus.")] = None,
) -> None:
    """Show the linearised modes about a state: frequencies, damping, stability.

    Joints, drivers, springs, weight, gyroscopic and centrifugal terms of the motion are included.
    With --vary the modes are followed over a parameter: Campbell diagram, root locus.

    Example: flexmb modes cases/slider_crank/scene.toml

    Example: flexmb modes scene.toml --vary speed=0..60:13 -o campbell.png
    """
    from flexmb.workflow import linearize

    changes = parse_pairs(overrides, "--set")
    if vary is None:
        refuse_options({"output": output, "root-locus": root_locus}, "draws what --vary computes")
        with screen.Bars() as progress:
            made = linearize.linearize(
                source, time=time, about=about, frame=frame, overrides=changes, progress=progress
            )
        _show_modes(made, count)
        if pictures is not None:
            shown = range(1, min(count, _MAX_PICTURES) + 1)
            for path in linearize.render_mode_shapes(made, pictures, list(shown)):
                screen.line(f"written: {path}")
        return
    refuse_options({"time": time, "pictures": pictures}, "belongs to one state; --vary has many")
    [(name, text)] = parse_pairs([vary], "--vary").items()
    with screen.Bars() as progress:
        sweep = linearize.sweep_modes(
            source, name, parse_values(text, "--vary"), about=about, frame=frame,
            overrides=changes, progress=progress,
        )  # fmt: skip
    _show_sweep(sweep, count, output, root_locus)


def parse_values(text: str, option: str) -> list[float | str]:
    """``0,10,20``, or ``0..100:11``: eleven values at equal distances; also with units."""
    values: list[float | str] = []
    try:
        for part in text.split(","):
            first, dots, rest = part.partition("..")
            if not dots:
                values.append(_with_unit(*_number_and_unit(part)))
                continue
            last, _, n = rest.partition(":")
            (a, unit), (b, same), n_values = _number_and_unit(first), _number_and_unit(last), int(n)
            if n_values < 2 or unit != same:  # noqa: PLR2004
                raise ValueError
            steps = [a + (b - a) * k / (n_values - 1) for k in range(n_values)]
            values += [_with_unit(value, unit) for value in steps]
    except ValueError:
        form = "0,10,20 or 0..100:11, and with units 0 ms..100 ms:11"
        raise typer.BadParameter(f'"{text}" is not of the form {form}', param_hint=option) from None
    return values


def _number_and_unit(text: str) -> tuple[float, str]:
    number, *unit = text.split(maxsplit=1)
    return float(number), "".join(unit)


def _with_unit(value: float, unit: str) -> float | str:
    return f"{value:.15g} {unit}" if unit else value


def _show_modes(made: Any, count: int) -> None:
    unit = made.compiled.layout
    screen.heading(
        f"{len(made.coordinates)} independent of {unit.nv} coordinates, at t = {made.time:g} s, "
        f"seen from {made.frame}"
    )
    if made.turn and made.whirl is None:
        screen.line(
            f"{made.frame} turns {made.turn / (2 * pi):.6g} times a second; --frame ground shows "
            "frequencies as its bearings see them"
        )
    shares = made.energy_shares
    rows = []
    for k in range(min(count, len(made.eigenvalues))):
        value, size = made.eigenvalues[k], abs(made.eigenvalues[k])
        largest = sorted(shares, key=lambda name: -shares[name][k])[:_BODIES]
        moving = ", ".join(
            f"{name} {100 * shares[name][k]:.0f} %"
            for name in largest
            if shares[name][k] > _LEAST_SHARE
        )
        moving = moving or "state of a controller"
        ratio = f"{made.damping_ratios[k]:.4g}" if size else "rigid"
        rows.append(
            (str(k + 1), f"{made.frequencies[k]:.6g}", f"{value.imag:.6g}", f"{value.real:.4g}",
             ratio, *(() if made.whirl is None else (made.whirl.senses[k],)), moving)
        )  # fmt: skip
    sense = () if made.whirl is None else ("whirl",)
    columns = (
        "mode",
        "Hz",
        "Im λ [rad/s]",
        "Re λ [1/s]",
        "damping ratio",
        *sense,
        "kinetic energy",
    )
    screen.table(columns, rows, right=(0, 1, 2, 3, 4))
    left = len(made.eigenvalues) - count
    if left > 0:
        screen.line(f"and {left} more (--count)")
    if not len(made.eigenvalues):
        screen.line("joints and drivers fix every motion: there are no modes")
    if made.stable:
        return
    grows = f"grows by a factor of e in {1.0 / made.eigenvalues.real.max():.3g} s"
    if made.unsteadiness == 0.0:
        screen.line(f"unstable: a mode {grows}")
    else:
        screen.line(
            f"a mode of this instant {grows}; where the state is not steady, that does not show "
            "whether it is stable"
        )


def _show_sweep(sweep: Any, count: int, output: Path | None, root_locus: Path | None) -> None:
    from flexmb.view.modes import campbell_figure, root_locus_figure
    from flexmb.view.plot import save_figure

    n = min(count, sweep.eigenvalues.shape[1])
    frames = " and ".join(sweep.frames)
    screen.heading(f"frequencies [Hz] over {sweep.parameter}, seen from {frames}")
    columns = (sweep.parameter, *(f"mode {k + 1}" for k in range(n)))
    rows = [
        (f"{value:g}", *(f"{frequency:.5g}" for frequency in line[:n]))
        for value, line in zip(sweep.values, sweep.frequencies, strict=True)
    ]
    screen.table(columns, rows, right=tuple(range(n + 1)), whole=True)
    growing = [
        f"{value:g}"
        for value, one in zip(sweep.values, sweep.linearizations, strict=True)
        if not one.stable and one.unsteadiness == 0.0
    ]
    if growing:
        screen.line(f"unstable at {sweep.parameter} = {', '.join(growing)}")
    for note in sweep.notes:
        screen.line(f"note: {note}")
    for path, draw in ((output, campbell_figure), (root_locus, root_locus_figure)):
        if path is not None:
            if path.suffix not in _ENDINGS:
                raise FlexmbError(f"{path}: the file must end in {' or '.join(_ENDINGS)}")
            screen.line(f"written: {save_figure(draw(sweep, count), path)}")


@command()
def response(
    source: Annotated[Path, typer.Argument(help="Scene file (TOML), result file or its folder.")],
    actuator: Annotated[
        str | None,
        typer.Option(
            "--input",
            help="What acts: a component of a force (push.x), a line force, spring or driver.",
        ),
    ] = None,
    sensor: Annotated[str | None, typer.Option(help="Channel that answers, such as tip.z.")] = None,
    frequencies: Annotated[
        str, typer.Option(help="In Hz: 1,2,5 or 0.1..100:200 (200 at equal ratios).")
    ] = "0.1..100:200",
    time: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Of a result: the output nearest to this time, such as 0.1 or '100 ms'.",
        ),
    ] = None,
    about: Annotated[
        str, typer.Option(help="Of a scene: quasi-static, undeformed, static or initial.")
    ] = "quasi-static",
    overrides: Overrides = None,
    output: Annotated[Path | None, output_option("Plot of amplitude and phase.")] = None,
) -> None:
    """Show the frequency response between an actuator and a sensor, about a state.

    Without --input and --sensor: the names that there are.

    Example: flexmb response scene.toml --input push.x --sensor tip.x --frequencies 1..200:400
    """
    from flexmb.view.plot import writable_file
    from flexmb.workflow import linearize

    values = _parse_frequencies(frequencies)
    if output is not None:
        writable_file(output, (".png", ".pdf", ".svg"))
    if (actuator is None) != (sensor is None) or (output is not None and sensor is None):
        missing = " and ".join(
            name for name, value in (("--input", actuator), ("--sensor", sensor)) if value is None
        )
        raise typer.BadParameter("is missing", param_hint=missing)
    with screen.Bars() as progress:
        made = linearize.linearize(
            source, time=time, about=about, overrides=parse_pairs(overrides, "--set"),
            progress=progress,
        )  # fmt: skip
    if actuator is None or sensor is None:
        screen.line(f"inputs: {', '.join(made.inputs) or 'none'}")
        screen.line(f"sensors: {', '.join(made.compiled.layout.channels) or 'none'}")
        return
    answer = made.frequency_response(actuator, sensor, values)
    screen.heading(f"{sensor} per unit of {actuator}, SI")
    shown = range(0, len(values), max(1, len(values) // _SHOWN_FREQUENCIES))
    rows = [
        (f"{values[k]:.5g}", f"{abs(answer[k]):.5g}", f"{degrees(phase(answer[k])):.1f}")
        if isfinite(answer[k])
        else (f"{values[k]:.5g}", "-", "-")
        for k in shown
    ]
    screen.table(("Hz", "amplitude", "phase [deg]"), rows, right=(0, 1, 2))
    finite = [k for k in range(len(values)) if isfinite(answer[k])]
    if finite:
        largest = max(finite, key=lambda k: abs(answer[k]))
        screen.line(f"largest: {abs(answer[largest]):.5g} at {values[largest]:.5g} Hz")
    none = [f"{values[k]:.5g}" for k in range(len(values)) if k not in finite]
    if none:
        where = ", ".join(none)
        screen.line(f"no steady response at {where} Hz: the motion grows without bound there")
    if output is not None:
        from flexmb.view.modes import response_figure
        from flexmb.view.plot import save_figure

        figure = response_figure(values, answer, f"{sensor} per {actuator}")
        screen.line(f"written: {save_figure(figure, output)}")


def _parse_frequencies(text: str) -> list[float]:
    from flexmb.model.scenes.study import sweep_values

    values = [*sweep_values(text)]
    wrong = [x for x in values if not isinstance(x, int | float) or not 0.0 <= x < inf]
    if wrong:
        what = f"frequencies [Hz] are not negative, such as 1,2,5 or 0.1..100:200; given {wrong[0]}"
        raise typer.BadParameter(what, param_hint="--frequencies")
    return [float(x) for x in values]


@command()
def statics(
    scene: Scene,
    vary: Annotated[
        str | None,
        typer.Option(
            "--vary",
            "-v",
            metavar="NAME=VALUES",
            help="A parameter, an entry by its path, or time, with values 0,10,20 or 0..100:11 "
            "(eleven at equal distances).",
        ),
    ] = None,
    channels: Annotated[
        str | None, typer.Option(help="Channels of sensors that are shown and drawn, with commas.")
    ] = None,
    starts: Annotated[
        int, typer.Option(help="Without --vary: poses from which equilibria are sought.", min=1)
    ] = 30,
    overrides: Overrides = None,
    output: Annotated[Path | None, output_option("With --vary: plot (.png, .pdf, .svg).")] = None,
    table: Annotated[Path | None, typer.Option(help="With --vary: all channels (.csv).")] = None,
) -> None:
    """Show the equilibria of a scene at rest, or follow one over a parameter or time.

    Without --vary: those that are reached from many poses, stable or not. With it: each from the
    one before, its stability, limit points, and values from which there is no equilibrium.

    `flexmb run --analysis statics` leaves a result file and a picture of one.

    Example: flexmb statics scene.toml --vary load=0..100:21 -o sweep.svg
    """
    from flexmb.model import load_scene
    from flexmb.view.plot import writable_file
    from flexmb.workflow import equilibria

    changes = parse_pairs(overrides, "--set")
    if vary is None:
        refuse_options({"output": output, "table": table}, "shows what --vary computes")
        with screen.Bars() as progress:
            states = equilibria.equilibria(
                scene, starts=starts, overrides=changes, progress=progress
            )
        _show_equilibria(states, parse_names(channels))
        return
    if output is not None:
        writable_file(output, (".png", ".pdf", ".svg"))
        if not load_scene(scene, dict(changes)).sensors:
            raise SceneError(
                "the scene has no sensor, whose channels --output draws; add one under [sensors], "
                "or leave --output out: the equilibria are listed without it"
            )
    if table is not None:
        writable_file(table, (".csv",))
    [(name, text)] = parse_pairs([vary], "--vary").items()
    with screen.Bars() as progress:
        sweep = equilibria.sweep_statics(
            scene, name, parse_values(text, "--vary"), overrides=changes, progress=progress
        )
    _show_static_sweep(sweep, parse_names(channels))
    if table is not None:
        screen.line(f"written: {sweep.to_csv(table)}")
    if output is not None:
        from flexmb.view.modes import equilibria_figure
        from flexmb.view.plot import save_figure

        figure = equilibria_figure(sweep, parse_names(channels))
        screen.line(f"written: {save_figure(figure, output)}")


def _show_equilibria(equilibria: Any, channels: list[str]) -> None:
    from flexmb.analysis.equilibrium_search import MAX_TURNS, largest_winding

    unit = equilibria[0].model.units
    names = channels or list(equilibria[0].compiled.layout.channels)[:_SHOWN]
    rows = []
    for k, one in enumerate(equilibria):
        growth, stable = one.growth()
        values = _without_round_off(one.channels(names))
        energy = unit.outward(one.energy, "J")
        rows.append((str(k + 1), _stability(growth, stable), f"{energy:.6g}",
                     *(f"{value:.6g}" for value in values)))  # fmt: skip
    columns = ("equilibrium", "stable", f"energy [{unit.label('J')}]", *names)
    screen.table(columns, rows, right=range(2, len(columns)), whole=True)
    for k, one in enumerate(equilibria):
        growth, stable = one.growth()
        if not stable:
            screen.line(f"{k + 1} is unstable: a disturbance grows by a factor of e in "
                        f"{1.0 / growth:.3g} s")  # fmt: skip
    for k, one in enumerate(equilibria):
        for limit in one.limits():
            screen.line(f"note: equilibrium {k + 1}: {limit.text()}")
    families = [str(k + 1) for k, one in enumerate(equilibria) if one.neutral_motions]
    if families:
        which = ", ".join(families)
        screen.line(f"{which}: nothing holds the bodies in some motion: each stands for all poses "
                    "of that motion, and their mirror images")  # fmt: skip
    if largest_winding(equilibria) > pi:
        screen.line(f"springs on angles were wound by up to {MAX_TURNS} turns from the first pose; "
                    "more --starts find more such equilibria")  # fmt: skip


def _without_round_off(values: Sequence[float]) -> list[float]:
    """Values of which those that are round-off of the largest are 0."""
    least = _ROUND_OFF * max(map(abs, values), default=0.0)
    return [0.0 if abs(value) < least else value for value in values]


def _show_static_sweep(sweep: Any, channels: list[str]) -> None:
    names = channels or [name for name in sweep.names if sweep[name].any()][:_SHOWN]
    units = [sweep.units[sweep.names.index(name)] for name in names if sweep[name] is not None]
    rows = []
    for k, p in enumerate(sweep.points):
        values = _without_round_off([sweep[name][k] for name in names])
        stable = _stability(p.growth, p.stable)
        rows.append((f"{p.value:.6g}", stable, *(f"{value:.6g}" for value in values)))
    shown = (f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=True))
    screen.table((sweep.parameter, "stable", *shown), rows, right=range(2, 2 + len(names)),
                 whole=True)  # fmt: skip
    for event in sweep.events:
        screen.line(event.sentence)
    for note in sweep.notes:
        screen.line(f"note: {note}")


def _stability(growth: float, stable: bool) -> str:
    return "?" if isnan(growth) else "yes" if stable else "no"
