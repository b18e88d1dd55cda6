"""What the loop is told: method, grid of outputs and steps, tolerances."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.work import kinds_of
from flexmb.model.scenes.dynamics import ACCURACY, DynamicsSpec

__all__ = [
    "Steps", "compared_times", "damps_vibrations", "kept_settings", "local_tolerance",
    "loop_settings", "output_times", "refinement", "scout_rows", "scout_settings", "time_grid",
    "with_tolerance",
]  # fmt: skip

_MAX_ITERATIONS = 15
_NEWTON, _NEWTON_OF_HIGH_ORDER = 1e-8, 1e-10  # relative, with fixed steps
# Local error over what is asked for in the end; of vibrations that are damped, whose measured error
# is a cautious one.
_LOCAL, _LOCAL_OF_VIBRATIONS = 0.2, 0.12
_HIGH_ORDER = 5
_SLACK = 4.0
_COMPARED = 51  # times beside listed outputs
_OF_SCOUT = 128  # outputs from which on a scout has fewer than the run
_AT_REST = 1e-6  # motion over the size of the model


@dataclass(frozen=True)
class Steps:
    """The grid of a run: mean interval of outputs, and fixed step, 0 for error control [s]."""

    interval: float
    step: float


def time_grid(spec: DynamicsSpec) -> Steps:
    """The largest step not above the one asked for that divides the interval of equal outputs.

    Where output times are listed, it divides the run.
    """
    listed = isinstance(spec.outputs, tuple)
    interval = spec.duration / (spec.n_rows if listed else spec.n_rows - 1)
    if spec.step is None:
        return Steps(interval, 0.0)
    whole = spec.duration if listed else interval
    every = max(1, math.ceil(whole / spec.step * (1.0 - 1e-12)))
    return Steps(interval, whole / every)


def output_times(spec: DynamicsSpec) -> np.ndarray:
    """Times of all outputs (n,) [s]."""
    if isinstance(spec.outputs, tuple):
        return np.array(spec.outputs)
    return np.arange(spec.outputs + 1) * (spec.duration / spec.outputs)


def compared_times(spec: DynamicsSpec) -> np.ndarray:
    """Times at which a run and its scout are compared: of outputs, and where these are listed of
    so many others that the peak-to-peak is known."""
    times = output_times(spec)
    if isinstance(spec.outputs, int):
        return times
    return np.union1d(times, np.linspace(0.0, spec.duration, _COMPARED))


def scout_rows(n: int) -> np.ndarray:
    """Which of n compared times a scout has rows at: of many every second, third, ...; (n,)."""
    rows = np.zeros(n, dtype=bool)
    rows[:: max(1, n // _OF_SCOUT)] = True
    rows[-1:] = True
    return rows


def damps_vibrations(compiled: Compiled, chosen: method.Method) -> bool:
    """Whether there are flexible bodies, and a method that damps what it does not resolve."""
    return chosen.stages == 0 and bool(compiled.system.parts.bodies["m"].any())


def local_tolerance(spec: DynamicsSpec, chosen: method.Method, compiled: Compiled) -> float:
    """First guess of the local error of a step, over the motion, for the accuracy asked for.

    n steps leave n local errors of order hᵖ⁺¹, so that the error in the end is of order hᵖ; the
    estimate of the method is of order hᵉ, and so are outputs inside a step where e < p. It is never
    so large that errors do not fall with the steps as the order says.
    """
    accuracy = ACCURACY if spec.accuracy is None else spec.accuracy
    power = max(chosen.error_order / chosen.order, 1.0)
    damped = chosen.order >= _HIGH_ORDER and damps_vibrations(compiled, chosen)
    share = _LOCAL_OF_VIBRATIONS if damped else _LOCAL
    return float(min(share * accuracy**power, chosen.loosest))


def with_tolerance(
    settings: method.Settings, spec: DynamicsSpec, chosen: method.Method, compiled: Compiled,
    tolerance: float,
) -> method.Settings:  # fmt: skip
    """The settings with another local tolerance; steps that are not ruled by it shrink as well."""
    finer = (tolerance / local_tolerance(spec, chosen, compiled)) ** (1.0 / chosen.error_order)
    return settings._replace(tolerance=tolerance, turn=settings.turn * finer)


def refinement(chosen: method.Method) -> float:
    """Steps of a run for each one of its scout: twice, or fewer where errors fall fast."""
    return 2.0 if chosen.order < _HIGH_ORDER else 1.6


def loop_settings(
    compiled: Compiled, spec: DynamicsSpec, chosen: method.Method, determined: bool
) -> method.Settings:
    """Of a run without scout; `determined` if the constraints alone fix the motion."""
    system, kinds, grid = compiled.system, kinds_of(compiled.system), time_grid(spec)
    works = bool(
        any(kind.works for kind in kinds)
        or np.any(system.rows["fun"] >= 0)
        or np.any(system.parts.bodies["damped"])
    )
    stiff = any(kind.is_stiff(system.kinds[kind.name]) for kind in kinds)
    newton = _NEWTON if chosen.order < _HIGH_ORDER else _NEWTON_OF_HIGH_ORDER
    return method.Settings(
        start=0.0,
        end=spec.duration,
        interval=grid.interval,
        step=grid.step,
        tolerance=0.0 if grid.step else local_tolerance(spec, chosen, compiled),
        accuracy=ACCURACY if spec.accuracy is None else spec.accuracy,
        slack=1.0,
        turn=1.0,
        refinement=0.0,
        least_motion=_AT_REST,
        newton_tolerance=spec.newton_tolerance or (newton if grid.step else 0.0),
        max_iterations=_MAX_ITERATIONS,
        works=int(works),
        stiff=int(stiff),
        determined=int(determined),
    )


def scout_settings(settings: method.Settings, chosen: method.Method) -> method.Settings:
    """Of the scout of a run: the tolerance that its longer steps leave."""
    factor = refinement(chosen) ** chosen.error_order
    return settings._replace(tolerance=settings.tolerance * factor)


def kept_settings(settings: method.Settings, chosen: method.Method) -> method.Settings:
    """Of a run that follows the steps of its scout; its own estimate is a safeguard only."""
    finer = refinement(chosen)
    rings = finer**chosen.error_order if chosen.order < _HIGH_ORDER else 1.0
    return settings._replace(refinement=finer, slack=_SLACK * rings)
