"""From errors to exit codes: one clear message, no traceback.

In: a command. Out: the same command, whose mistakes of the user end in exit code 2, whose
interruption ends in 130, and whose faults of our own end in 1 with a request to report them.
"""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import typer

from flexmb.errors import FlexmbError

__all__ = ["FAULT", "FAILED_CHECK", "INTERRUPTED", "MISTAKE", "guarded", "settings"]

FAULT, MISTAKE, FAILED_CHECK, INTERRUPTED = 1, 2, 3, 130


@dataclass
class Settings:
    """What the options before the command say."""

    debug: bool = False


settings = Settings()


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """The command with errors turned into messages and exit codes."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning  # type: ignore[assignment]
            try:
                command(*args, **kwargs)
            except FlexmbError as error:
                _leave(f"error: {error}", MISTAKE)
            except KeyboardInterrupt:
                _leave("stopped", INTERRUPTED)
            except (typer.Exit, typer.Abort, typer.BadParameter):
                raise
            except Exception as error:  # noqa: BLE001  the border: all faults become one line
                if settings.debug:
                    raise
                _leave(_fault(error), FAULT)

    return run


def _leave(message: str, code: int) -> None:
    typer.echo(message, err=True)
    raise typer.Exit(code) from None


def _fault(error: Exception) -> str:
    from flexmb import __version__

    return (
        f"error: flexmb {__version__} failed unexpectedly "
        f"({type(error).__name__}: {error}).\n"
        "This is a fault of flexmb, not of your input. Please report it with the scene and what\n"
        f"`flexmb --debug {' '.join(sys.argv[1:])}` prints."
    )


def _show_warning(message: Any, category: Any, *_: Any) -> None:
    from flexmb.errors import FlexmbWarning

    if issubclass(category, FlexmbWarning) or settings.debug:
        typer.echo(f"warning: {message}", err=True)
