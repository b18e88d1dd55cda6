"""The command line: what a person types, and what the screen says.

In: arguments. Out: calls of the library, progress bars, tables, one clear sentence per mistake and
an exit code: 0 done, 1 a fault of flexmb, 2 a mistake in the input, 3 a check of the scene failed,
130 stopped by Ctrl-C.
"""

from __future__ import annotations

from flexmb.cli import discover as discover  # adds its commands to the app
from flexmb.cli import help as help
from flexmb.cli import study as study
from flexmb.cli.app import app, main

__all__ = ["app", "main"]
