"""Compiling ahead what runs would compile at their start.

In: the names of integrators. Out: the kernels of the usual combinations of features in the cache,
and how long each took. A run compiles for the features its scene uses (springs, joints about lines
and so on), once per machine; after a warm-up the usual ones start at once.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, get_args

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.progress import Progress, silent

if TYPE_CHECKING:
    from flexmb.model import Model

__all__ = ["FEATURES", "Warmed", "warmup"]

FEATURES = (
    ("joints", "drivers", "loads"),
    ("joints", "drivers", "loads", "springs"),
    ("joints", "drivers", "loads", "kinks"),
)
"""What is compiled ahead; bodies may be rigid or flexible, sensors are always there."""


class Warmed(NamedTuple):
    """What a warm-up did."""

    cache: Path
    rows: tuple[tuple[str, str, float], ...]
    """Features, method and seconds of each combination."""


def warmup(methods: Sequence[str] = (), progress: Progress = silent) -> Warmed:
    """Compile the kernels of the usual combinations of features, or find them in the cache.

    Parameters
    ----------
    methods : sequence of str
        Names as in ``dynamics.method``; all of them by default.
    progress : Progress
        Told one phase for each combination.

    Raises
    ------
    FlexmbError
        An unknown method; lists those there are, nearest first.
    """
    from flexmb.analysis.dynamics.analysis import prepare
    from flexmb.engine.compile import compile_system
    from flexmb.engine.jit import CACHE_DIR

    rows: list[tuple[str, str, float]] = []
    for label, model in _models(_chosen(methods)):
        assert model.dynamics is not None
        method = model.dynamics.method
        phase = f"{label}, {method}"
        started = time.perf_counter()
        prepare(compile_system(model), model, progress=_under(phase, progress))
        rows.append((label, method, time.perf_counter() - started))
        progress(phase, 1.0)
    return Warmed(CACHE_DIR, tuple(rows))


def _chosen(methods: Sequence[str]) -> tuple[str, ...]:
    from flexmb.model.tasks.dynamics import DynamicsSpec

    known = get_args(DynamicsSpec.model_fields["method"].annotation)
    wrong = [name for name in methods if name not in known]
    if wrong:
        found = (Problem("", f'unknown method "{n}"', known, nearest(n, known)) for n in wrong)
        raise FlexmbError.from_problems(found)
    return tuple(methods) or known


def _models(methods: Sequence[str]) -> Iterator[tuple[str, Model]]:
    for method, features in product(methods, FEATURES):
        yield ", ".join(features), _model(method, features)


def _model(method: str, features: Sequence[str]) -> Model:
    """The smallest model with these features; only the types of its tables matter."""
    from flexmb.model import Model

    model = Model("warm-up")
    model.add_body("rigid", mass=1.0, inertia=[1.0, 1.0, 1.0])
    model.add_marker("rigid.end", position=[1.0, 0.0, 0.0])
    model.add_joint("joint", "revolute", between=["ground", "rigid"], axis="z")
    if "springs" in features:
        spring = {"stiffness": 1.0, "damping": 0.1}
        model.add_force("spring", "spring-damper", between=["ground", "rigid.end"], **spring)
    model.add_sensor("rigid", "position", of="rigid")
    if "kinks" in features:  # of functions of time, at which steps by error control end
        pulse = {"type": "step", "t0": 2e-4, "t1": 4e-4, "y1": 1.0}
        model.add_force("pulse", "force", at="rigid.end", value=[pulse, 0, 0])
        model.set_dynamics(duration=1e-3, accuracy=1e-3, method=method)
    else:
        model.set_dynamics(duration=1e-3, step=1e-4, method=method)
    return model


def _under(whole: str, progress: Progress) -> Progress:
    """Progress of whatever phase as that of one phase, which is not over yet."""

    def told(phase: str, fraction: float, detail: str = "") -> None:
        progress(whole, min(fraction, 0.99), detail or phase)

    return told
