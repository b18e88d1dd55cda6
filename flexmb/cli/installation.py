"""``flexmb doctor`` and ``flexmb warmup``: the state of this installation, compiling ahead."""

from __future__ import annotations

import typer

from flexmb.cli import screen
from flexmb.cli.app import MISTAKE, command


@command()
def doctor() -> None:
    """Report what works on this machine and what to install: versions, rendering, cache, compiler.

    Ends in exit code 2 if something is missing.
    """
    from flexmb import workflow

    with screen.Bars() as progress:
        state = workflow.examine_installation(progress)
    screen.heading(f"flexmb {state.version}")
    screen.line(f"Python {state.python}")
    screen.line(state.system)
    rows = [(name, version or "MISSING", purpose) for name, version, purpose in state.packages]
    rows += [
        (name, version or "not installed (optional)", purpose)
        for name, version, purpose in state.optional
    ]
    screen.table(("package", "version", "for"), rows)
    screen.table(("part", "state", ""), state.parts)
    if state.missing:
        screen.line(f"missing: python -m pip install {' '.join(state.missing)}")
        raise typer.Exit(MISTAKE)


@command()
def warmup() -> None:
    """Compile ahead all that runs would compile at first.

    Takes about a minute, once per machine and version. Without it the first run of a scene compiles
    the parts that it uses. Ctrl-C keeps what is compiled already.

    Example: flexmb warmup
    """
    from flexmb import workflow

    with screen.Bars() as progress:
        done = workflow.warmup(progress)
    screen.line(
        f"{done.units} units, {done.compiled} of them compiled in {done.seconds:.1f} s; "
        f"{done.size / 1e6:.1f} MB in {done.cache}"
    )
