"""``flexmb plot``: channels as histories, spectra and paths; ``flexmb report``: a web page."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import command, output_option, parse_names
from flexmb.cli.render import ViewWords, view_words
from flexmb.errors import FlexmbError, ResultFileError

_KINDS = "history, phase, spectrum, campbell, hodograph, energy, reactions or modes"
_RESULT_ENDINGS = (".h5", ".hdf5")
_LISTED = 400  # names of one kind


@command()
def plot(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="RESULT|CHANNEL",
            help="One or more result files or their folders, then names of channels, perhaps with "
            "* and ?; by default those that the scene names.",
        ),
    ],
    kind: Annotated[
        str,
        typer.Option(
            "--kind",
            "-k",
            help=f"{_KINDS}. Of energy none need be named, of reactions joints, of modes bodies, "
            "of a hodograph vectors such as crank_pin.rod.force.",
        ),
    ] = "history",
    against: Annotated[
        str | None,
        typer.Option(
            metavar="CHANNEL",
            help="The channel of the abscissa in place of time; of campbell a speed.",
        ),
    ] = None,
    times: Annotated[
        str | None,
        typer.Option(
            metavar="FIRST..LAST",
            help="Times between which to draw, 0.02..0.04 in the scene's units or '20 ms..40 ms'.",
        ),
    ] = None,
    log: Annotated[bool, typer.Option("--log", help="Of a spectrum: amplitudes as logs.")] = False,
    output: Annotated[
        Path | None,
        output_option(
            "File that ends in .png, .pdf or .svg; plot.png beside the (first) result by default."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
    list_channels: Annotated[
        bool, typer.Option("--list", help="List the channels that can be drawn, and draw nothing.")
    ] = False,
) -> None:
    """Plot channels of one or several results: over time, over one another, as spectra, paths.

    Nothing needs to be asked for in the scene: besides sensors there are reactions, energies,
    stress, and the motion of every marker and joint, recovered from the stored states (--list).

    Example: flexmb plot out/slider_crank slider.x crank_pin.rod.force -o slider.svg

    Example: flexmb plot out/slow out/fast "rod.eta.*" --times 0.02..0.04

    Example: flexmb plot out/slider_crank --kind spectrum rod.big_end.acceleration.y --log
    """
    from flexmb.model.scenes.parameters import read_span
    from flexmb.results import Result

    paths, channels = _split(names)
    results = [Result(path) for path in paths]
    if list_channels:
        _list_channels(results, channels)
        return
    path = output or results[0].path.parent / "plot.png"
    if output is not None and path.exists() and not force:
        raise FlexmbError(f"{path}: exists; give --force to replace it, or another --output")
    span = None if times is None else read_span(results[0].model, times)
    written = _draw(results, channels, kind, against, span, log, path)
    screen.line(f"written: {written}")
    for result in results:
        lacking = [name for name in channels if kind == "history" and not _has(result, name)]
        if lacking:
            screen.line(f"note: {result.path} has no {', '.join(lacking)}")
    systems = {result.units.name for result in results}
    if len(systems) > 1:
        screen.line(
            f"note: all are drawn in the units of {results[0].path} ({results[0].units.name})"
        )


def _draw(
    results: list[Any],
    channels: list[str],
    kind: str,
    against: str | None,
    times: tuple[float, float] | None,
    log: bool,
    path: Path,
) -> Path:
    from flexmb.view.charts import CHARTS, xy_figure
    from flexmb.view.plot import save_figure

    if kind not in CHARTS:
        raise FlexmbError.unknown_name("kind of plot", kind, CHARTS)
    if kind in ("phase", "campbell", "hodograph") and not channels:
        raise FlexmbError(f"--kind {kind} needs the name of a channel (--list shows them)")
    if log and kind != "spectrum":
        raise FlexmbError("--log belongs to --kind spectrum")
    if against is not None and kind == "history":
        return save_figure(xy_figure(results, channels, against, times), path)
    if against is not None and kind != "campbell":
        raise FlexmbError("--against belongs to histories (x-y plots) and to --kind campbell")
    more: dict[str, Any] = {"log": True} if log else {}
    if kind == "campbell":
        more["against"] = against
    return save_figure(CHARTS[kind](results, channels, times=times, **more), path)


def _has(result: Any, pattern: str) -> bool:
    from flexmb.view.history import select_series

    try:
        return bool(select_series([result], [pattern]))
    except FlexmbError:
        return False


def _split(names: list[str]) -> tuple[list[Path], list[str]]:
    """Paths of results, the first name and those that can be nothing else; names of channels."""
    is_path = [k == 0 or _is_path(name) for k, name in enumerate(names)]
    paths = [Path(name) for name, one in zip(names, is_path, strict=True) if one]
    for path in paths:
        if not path.exists():
            raise ResultFileError(f"{path}: there is no such result (result.h5 or its folder)")
    return paths, [name for name, one in zip(names, is_path, strict=True) if not one]


def _is_path(name: str) -> bool:
    path = Path(name)
    return (path / "result.h5").is_file() or path.suffix in _RESULT_ENDINGS or "/" in name


def _list_channels(results: list[Any], patterns: list[str]) -> None:
    """Show the channels of the first result by kind, or those that patterns mean, with units."""
    result = results[0]
    if patterns:
        for name in dict.fromkeys(name for p in patterns for name in result.match(p)):
            screen.line(f"{name} [{result.unit(name)}]" if result.unit(name) else name)
        return
    kinds = ("sensors", "reactions", "energy", "drift", "stress", "motion", "coordinates",
             "accelerations")  # fmt: skip
    for kind in kinds:
        names = result.channels(kind)
        if names:
            screen.heading(kind)
            for line in _grouped(result, names[:_LISTED]):
                screen.line(f"  {line}")


def _grouped(result: Any, names: tuple[str, ...]) -> list[str]:
    """Names with their units, those that differ in their last part alone on one line."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in names:
        stem, _, end = name.rpartition(".")
        groups.setdefault((stem, result.unit(name)), []).append(end)
    lines = []
    for (stem, unit), ends in groups.items():
        numbers = len(ends) > 3 and all(end.isdecimal() for end in ends)
        shown = f"{ends[0]}..{ends[-1]}" if numbers else ", ".join(ends)
        shown = f"{{{shown}}}" if len(ends) > 1 else shown
        lines.append(f"{stem}.{shown}"[not stem :] + (f" [{unit}]" if unit else ""))
    return lines


@command()
def report(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT",
            help="A result file or its folder, the folder of a study or a sweep, or several "
            "results.",
        ),
    ],
    output: Annotated[
        Path | None,
        output_option("File that ends in .html; report.html beside the (first) result by default."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
    no_motion: Annotated[
        bool, typer.Option("--no-motion", help="Leave the moving machine out: a smaller page.")
    ] = False,
    parts: Annotated[
        str | None,
        typer.Option(
            help="Of the page on one run, with commas: summary, motion, pictures, checks, plots, "
            "model, effects, accuracy, hot_spots, modes, provenance; all by default."
        ),
    ] = None,
    view: ViewWords = None,
    show: Annotated[bool, typer.Option("--show", help="Open the page in the browser.")] = False,
) -> None:
    """Write a report: one web page that needs nothing else, to read, print and send on.

    What was simulated, the machine in motion, pictures, plots, effects and their audit, accuracy
    and cost, hot spots, modes, notes, provenance. Several results are put beside each other; the
    folder of a study gives what accuracy costs.

    Example: flexmb report out/slider_crank

    Example: flexmb report out/slow out/fast -o both.html

    Example: flexmb report out/slider_crank --parts motion,plots --view camera=top
    """
    from flexmb.workflow.result_page import report as write_report

    for source in sources:
        if not source.exists():
            raise FlexmbError(f"{source}: there is no such result")
    if output is not None and output.exists() and not force:
        raise FlexmbError(f"{output}: exists; give --force to replace it, or another --output")
    words = view_words(None, None, None, None, None, None, view)
    with screen.Bars() as progress:
        path = write_report(
            *sources,
            output=output,
            parts=parse_names(parts) or None,
            motion=not no_motion,
            view=words,
            progress=progress,
        )
    screen.line(f"written: {path} ({path.stat().st_size / 1e6:.1f} MB)")
    if show:
        webbrowser.open(path.resolve().as_uri())
