"""The application: its options, the values that options take, and errors as exit codes.

A command is a function under ``@command()``. Mistakes of the user end in exit code 2 with one
message, an interruption in 130, faults of flexmb in 1 with a request to report them.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import functools
import gc
import io
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from flexmb import __version__
from flexmb.errors import FlexmbError, FlexmbWarning, nearest, printable
from flexmb.progress import Progress

FAULT, MISTAKE, FAILED_CHECK, INTERRUPTED = 1, 2, 3, 130
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)  # what a disk says of itself

_ABOUT = """
Flexible multibody dynamics: from a finite-element mesh to a moving, deforming machine.

A scene file (TOML) names bodies, joints, drivers, forces and sensors; `flexmb run` reduces the
meshes it names, simulates it and leaves a result file, a picture and a plot.
"""

_EXAMPLES = """
Examples:

flexmb new my_pendulum

flexmb run cases/slider_crank/scene.toml

flexmb run scene.toml --set speed="2*pi*50" --output out/fast

flexmb resume out/slider_crank

flexmb render out/slider_crank/result.h5 --time 0.013 --output rod.png

flexmb plot out/slider_crank slider.x crank_pin.rod.force

flexmb report out/slider_crank

flexmb export out/slider_crank --channels slider.x,energy.kinetic --output slider.csv

flexmb reduce cases/slider_crank/scene.toml --body rod --report

flexmb render out/slider_crank/rod.flexbody.h5 --modes 1..6

flexmb list joints

Exit codes: 0 done, 1 a fault of flexmb, 2 a mistake in the input, 3 a check failed, 130 Ctrl-C.
"""


def _other_way(word: str, options: list[str]) -> str:
    """How a command takes a word of ``[view]`` or ``[dynamics]`` that is no option of it; or ""."""
    from flexmb.model.scenes.dynamics import DynamicsSpec
    from flexmb.model.scenes.sections import ViewSpec

    if "--view" in options and word in ViewSpec.model_fields:
        return f"--view {word}=VALUE"
    if "--set" in options and word in DynamicsSpec.model_fields:
        return f"--set dynamics.{word}=VALUE"
    return ""


# Letters of a word that is no command, by which the help of commands is searched; most commands
# that are named.
_STEM, _MOST_NAMED = 5, 4


class _Commands(TyperGroup):
    """The commands; an option that the command does not have is told of those that have it, and a
    word that is no command of the commands that explain it."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command of the first word, as its superclass does."""
        try:
            return super().resolve_command(ctx, args)
        except Exception as error:
            stem = args[0].lower()[:_STEM]
            named = [k for k, one in self.commands.items() if stem in f"{one.help}".lower()]
            begins = any(name.startswith(stem) for name in self.commands)
            if 0 < len(named) <= _MOST_NAMED and len(stem) == _STEM and not begins:
                what = f'No such command "{args[0]}"; its word is in the help of '
                vars(error)["message"] = what + ", ".join(named)
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run a command, as its superclass does."""
        try:
            return super().invoke(ctx)
        except Exception as error:
            option, of = getattr(error, "option_name", ""), getattr(error, "ctx", None)
            if isinstance(error, typer.BadParameter) or not option or of is None:
                raise
            own = [word for parameter in of.command.params for word in parameter.opts]
            others = [
                name
                for name, command in self.commands.items()
                if any(option in parameter.opts for parameter in command.params)
            ]
            vars(error)["possibilities"] = nearest(option, own)
            if option == "--debug":
                vars(error)["message"] += "; it stands before the command: flexmb --debug ..."
            elif option not in own and (way := _other_way(option.lstrip("-"), own)):
                vars(error).update(possibilities=[])
                vars(error)["message"] += f"; it is given as {way}"
            elif others and option not in own:
                shown = [*others[:5], *([f"{len(others) - 5} more"] if len(others) > 5 else [])]
                vars(error)["message"] += f"; it is an option of {', '.join(shown)}"
            raise


app = typer.Typer(
    name="flexmb",
    cls=_Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    help=_ABOUT,
    epilog=_EXAMPLES,
)
_options = {"debug": False}  # before the command


def output_option(help: str) -> Any:
    """The option ``--output`` of a command, ``-o`` for short."""
    return typer.Option("--output", "-o", help=help)


Scene = Annotated[Path, typer.Argument(help="Scene file (TOML).")]
RunFile = Annotated[Path, typer.Argument(help="Result file, or the folder it is in.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        "-s",
        metavar="NAME=VALUE",
        help="A new value for a parameter of the scene or for any entry by its path, such as "
        "dynamics.step=1e-5; may be repeated.",
    ),
]
Workers = Annotated[
    int, typer.Option(help="Runs at the same time. 1 disturbs the timings least.", min=1)
]
Scheduler = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="Dask scheduler whose workers do the runs, such as tcp://host:8786; by default "
        "processes of this machine (flexmb help cluster).",
    ),
]
Limit = Annotated[
    float,
    typer.Option(
        metavar="SECONDS", help="Give up a run that takes longer.", min=0.0, show_default=False
    ),
]
Dashboard = Annotated[
    bool, typer.Option("--dashboard", help="Serve Dask's page on the work and say its address.")
]
JudgedSensors = Annotated[
    list[str] | None,
    typer.Option(
        "--sensor", help="Sensor or channel to judge by; may be repeated; all by default."
    ),
]
RunsFolder = Annotated[
    Path | None,
    output_option("Folder of the runs; by default out/<scene>/ with this command's name."),
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Run again what an earlier call left there.")]
NoPicture = Annotated[bool, typer.Option("--no-picture", help="Do not draw the picture and plot.")]


def main() -> None:
    """The entry point of the command ``flexmb``."""
    gc.set_threshold(50_000)  # imports make many objects that stay: a tenth of a short command
    atexit.register(gc.freeze)  # not to walk over them once more at the end: a fifth of it
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a pipe on Windows may lack the letters we use
            stream.reconfigure(errors="replace")
    try:
        app(prog_name="flexmb")
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _show_version(requested: bool) -> None:
    if requested:
        typer.echo(f"flexmb {__version__}")
        raise typer.Exit


@app.callback()
def _set_options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an unexpected failure.")
    ] = False,
) -> None:
    _options["debug"] = debug


def command(name: str | None = None) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator: adds a command to the application, its errors turned into exit codes."""

    def add(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def run(*args: Any, **options: Any) -> None:
            with warnings.catch_warnings():
                warnings.showwarning = functools.partial(_show_warning, set())
                try:
                    function(*args, **options)
                except FlexmbError as error:
                    _leave(f"error: {error}", MISTAKE)
                except KeyboardInterrupt:
                    _leave("stopped", INTERRUPTED)
                except (typer.Exit, typer.Abort, typer.BadParameter):
                    raise
                except Exception as error:  # noqa: BLE001  the border: all faults become one line
                    if _options["debug"]:
                        raise
                    if isinstance(error, OSError) and (error.filename or error.errno in _FULL):
                        _leave(f"error: {error.filename or 'a file'}: {error.strerror}", MISTAKE)
                    _leave(_fault_message(error), FAULT)

        return app.command(name)(run)

    return add


def _leave(message: str, code: int) -> None:
    typer.echo(printable(message), err=True)
    raise typer.Exit(code) from None


def _fault_message(error: Exception) -> str:
    return (
        f"error: flexmb {__version__} failed unexpectedly ({type(error).__name__}: {error}).\n"
        "This is a fault of flexmb, not of your input. Please report it with the scene and what\n"
        f"`flexmb --debug {' '.join(sys.argv[1:])}` prints."
    )


def _show_warning(shown: set[str], message: Any, category: Any, *_: Any) -> None:
    """Each sentence once."""
    text = str(message)
    if text not in shown and (issubclass(category, FlexmbWarning) or _options["debug"]):
        shown.add(text)
        typer.echo(f"warning: {printable(text)}", err=True)


def refuse_options(options: dict[str, Any], why: str) -> None:
    """Refuse options that have a value, by name, with the reason."""
    for name, value in options.items():
        if value is not None and value is not False and value != []:
            raise typer.BadParameter(why, param_hint=f"--{name.replace('_', '-')}")


@contextlib.contextmanager
def repeatable_runs() -> Iterator[Progress]:
    """Progress of many runs, which the same command continues after Ctrl-C."""
    from flexmb.cli import screen

    try:
        with screen.Bars() as progress:
            yield progress
    except KeyboardInterrupt:
        screen.line("stopped; finished runs stay on disk, and the same command continues")
        raise typer.Exit(INTERRUPTED) from None


def parse_pairs(texts: list[str] | None, option: str) -> dict[str, str]:
    """``["a=1", "b=x=y"]`` as a dictionary."""
    pairs: dict[str, str] = {}
    for text in texts or []:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise typer.BadParameter(f'"{text}" is not of the form name=value', param_hint=option)
        if name in pairs:
            raise typer.BadParameter(f'"{name}" is given twice', param_hint=option)
        pairs[name] = value
    return pairs


def parse_table(text: str, option: str) -> Any:
    """A word, or a table such as ``{E = 70e9, nu = 0.33, density = 2700}`` as in a scene."""
    if not text.lstrip().startswith("{"):
        return text
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise typer.BadParameter(f"{text} is no table ({error})", param_hint=option) from None


def parse_direction(text: str | None) -> tuple[float, float, float] | None:
    """``x``, ``-y``, ``z`` or three numbers ``1,-1,0.5``."""
    if text is None:
        return None
    sign, letter = (-1.0, text[1:]) if text.startswith("-") else (1.0, text)
    if letter in ("x", "y", "z"):
        x, y, z = (sign * float(letter == axis) for axis in "xyz")
        return x, y, z
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        expected = "x, y, z, -x, -y, -z or three numbers such as 1,-1,0.5"
        raise typer.BadParameter(f'"{text}" is not {expected}', param_hint="--direction") from None
    return x, y, z


def parse_exaggeration(text: str | None) -> float | str | None:
    """A number, or ``auto``."""
    if text is None or text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f'"{text}" is neither a number nor auto', param_hint="--exaggeration"
        ) from None


def parse_numbers(text: str | None, option: str) -> list[int] | None:
    """``7``, ``1..6`` or ``1,3,5`` as a list."""
    if text is None:
        return None
    numbers: list[int] = []
    try:
        for part in text.split(","):
            first, dots, last = part.partition("..")
            numbers += range(int(first), int(last) + 1) if dots else [int(first)]
    except ValueError:
        raise typer.BadParameter(
            f'"{text}" is not of the form 7, 1..6 or 1,3,5', param_hint=option
        ) from None
    return numbers


def parse_names(text: str | None) -> list[str]:
    """``a, b`` as a list; empty for nothing."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def parse_size(text: str | None) -> tuple[int, int] | None:
    """``1280x720`` as width and height."""
    if text is None:
        return None
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise typer.BadParameter(
            f'"{text}" is not width x height such as 1280x720', param_hint="--size"
        ) from None
    return width, height
