"""The command line: commands, their options, and what the screen shows.

In: arguments. Out: calls of the library, progress bars, tables, one clear sentence per mistake and
an exit code: 0 done, 1 a fault of flexmb, 2 a mistake in the input, 3 a check of the scene failed,
130 stopped by Ctrl-C.
"""

from __future__ import annotations

# each adds its commands to the application, in this order of the help
from flexmb.cli import run as run  # isort: skip
from flexmb.cli import check as check  # isort: skip
from flexmb.cli import reduce as reduce  # isort: skip
from flexmb.cli import part as part  # isort: skip
from flexmb.cli import postprocess as postprocess  # isort: skip
from flexmb.cli import render as render  # isort: skip
from flexmb.cli import plot as plot  # isort: skip
from flexmb.cli import modes as modes  # isort: skip
from flexmb.cli import study as study  # isort: skip
from flexmb.cli import listings as listings  # isort: skip
from flexmb.cli.app import app, main

__all__ = ["app", "main"]
