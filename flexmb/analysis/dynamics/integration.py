"""One integration: its settings (grid of outputs and steps, tolerances), tables, state and rows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flexmb.analysis.dynamics.compared_quantities import parts_of_model
from flexmb.analysis.procedure import ChunkRows
from flexmb.engine import entries, method
from flexmb.engine.bodies.static_modes import STATIC_MODES
from flexmb.engine.compile import Compiled
from flexmb.engine.forces.friction import BRISTLE
from flexmb.engine.method import round_off
from flexmb.engine.state import Plan, State, Work
from flexmb.engine.units import hand_over
from flexmb.engine.work import equal_times, kinds_of, new_plan, new_run, new_work, output_run
from flexmb.errors import FlexmbError
from flexmb.model.scenes.dynamics import ACCURACY, DynamicsSpec
from flexmb.results.writer import OutputBlock

_MAX_ITERATIONS = 15
_NEWTON, _NEWTON_OF_HIGH_ORDER = 1e-8, 1e-10  # relative, with fixed steps
# Local error over the requested one, of high order or not: with 0.1 half of 171 first passes of the
# judging scenes are below 0.1 times it and a fifth are repeated (order 8; 0.6 and a half, order 5).
_LOCAL = {True: 0.1, False: 0.2}
_HIGH_ORDER = 5
# Local error of a run over that of its shorter steps, where one lies across two of its scout
# (explicit or not). By order 8, 4, 2, 1, 0.7 exceed twice the request in 1, 0, 0, 0 of 450 runs and
# misjudge 6, 6, 6, 11, at 1, 1.02, 1.08, 1.16 times the cost; 4 or 2 misjudge 5 of 498 of radau.
_SLACK = {True: 2.0, False: 4.0}
_COMPARED = 51  # times in addition to outputs that are fewer or listed
_SAME_TIME = 1e-9  # difference of two times that are one but for round-off, over the duration
_SCOUT_ROWS = 128  # outputs from which on a scout has fewer than the run
_AT_REST = 1e-6  # motion over the size of the model
# What round-off of positions, over their distance from the origin, leaves in estimates: of Radau's
# method, which solves for the motion of a step, and of others.
_SOLVED, _NOISE = 5e-14, 2e-17
_SHARE_AT_REST = 1e-3  # of what counts for the model, for one of its parts
_FASTER = 1e3  # speed at rest over its mean in the run: round-off is fast
_STATE = 1e-3  # size of a scalar coordinate, of which nothing is known
# Steps of a chunk times velocity coordinates: about a tenth of a second on a present machine.
_CHUNK_WORK = 200_000
_RINGING_STEPS = 4  # from an output on: their differences show what alternates
_MIN_CHUNK = 4  # steps, after which the state is saved
# Steps between two looks at how long the rest of a run will take, and steps for it that are too
# many, also times velocity coordinates and stages; fewer where stability limits them, which another
# method is free of.
_CHECK_EVERY = 5_000
_MAX_STEPS, _MAX_STABLE_STEPS = (1e9, 1e11), (1e7, 2e9)
_MAX_STATIC_STEPS = 1e5  # of an explicit method with quasi-static modes beside dynamic ones
# Share of steps at the limit of stability that makes a run one that stability limits.
_STIFF_SHARE = 0.35


@dataclass(frozen=True)
class Steps:
    """The grid of a run: mean interval of outputs, and fixed step, 0 for error control [s]."""

    interval: float
    step: float


def time_grid(spec: DynamicsSpec) -> Steps:
    """The largest step not above the requested one that divides the interval of equal outputs.

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
    """Times at which a run and its scout are compared: of outputs, and where these are few or
    listed of so many others that the peak-to-peak is known."""
    times = output_times(spec)
    if isinstance(spec.outputs, int) and len(times) >= _COMPARED:
        return times
    others = np.linspace(0.0, spec.duration, _COMPARED)
    edges = np.concatenate([[-np.inf], times, [np.inf]])
    after = np.searchsorted(edges, others)
    apart = np.minimum(others - edges[after - 1], edges[after] - others)
    return np.union1d(times, others[apart > _SAME_TIME * spec.duration])


def scout_rows(n: int) -> np.ndarray:
    """Which of n compared times a scout has rows at: of many every second, third, ...; (n,)."""
    rows = np.zeros(n, dtype=bool)
    rows[:: max(1, n // _SCOUT_ROWS)] = True
    rows[-1:] = True
    return rows


def damps_vibrations(compiled: Compiled, integrator: method.Method) -> bool:
    """Whether there are flexible bodies, and a method that damps what it does not resolve."""
    return integrator.stages == 0 and bool(compiled.system.parts.bodies["m"].any())


def gyration(compiled: Compiled) -> dict[str, float]:
    """Radius of gyration of each flexible body about the origin of its frame, by its name [m]."""
    rows = zip(compiled.layout.bodies, compiled.system.parts.bodies, strict=True)
    return {
        body.name: float(np.sqrt(np.trace(row["S0"]) / row["mass"]))
        for body, row in rows
        if row["m"]
    }


def remembers_bristles(compiled: Compiled) -> bool:
    """Whether balls stick by bristles, which each step stretches by its last velocity."""
    contacts = compiled.system.kinds.get("contacts")
    rows = None if contacts is None else contacts.rows
    return rows is not None and bool(np.any((rows["model"] == BRISTLE) & (rows["ri"] > 0.0)))


def local_tolerance(spec: DynamicsSpec, integrator: method.Method) -> float:
    """First guess of the local error of a step, over the motion, for the requested accuracy.

    n steps leave n local errors of order hᵖ⁺¹, so that the error in the end is of order hᵖ; the
    estimate of the method is of order hᵉ, and so are outputs inside a step where e < p. It is never
    so large that errors do not fall with the steps as the order says.
    """
    accuracy = ACCURACY if spec.accuracy is None else spec.accuracy
    power = max(integrator.error_order / integrator.order, 1.0)
    local = _LOCAL[integrator.order >= _HIGH_ORDER]
    return float(min(local * accuracy**power, integrator.loosest))


def with_tolerance(
    settings: method.Settings, spec: DynamicsSpec, integrator: method.Method, tolerance: float
) -> method.Settings:
    """The settings with another local tolerance; steps that are not ruled by it shrink as well."""
    finer = (tolerance / local_tolerance(spec, integrator)) ** (1.0 / integrator.error_order)
    return settings._replace(tolerance=tolerance, turn=settings.turn * finer)


def refinement(integrator: method.Method) -> float:
    """Steps of a run for each one of its scout: twice, or fewer where errors fall fast.

    The error told over the true one of the judging scenes, a tenth of them below and a tenth above:
    0.8 to 2.7 with 1.6 and order 8, 0.5 to 2.7 with 2; 0.9 to 2.6 and 0.8 to 4 with order 5.
    """
    return 2.0 if integrator.order < _HIGH_ORDER else 1.6


def loop_settings(
    compiled: Compiled, spec: DynamicsSpec, integrator: method.Method, determined: bool
) -> method.Settings:
    """Of a run without scout; `determined` if the constraints alone fix the motion."""
    system, kinds, grid = compiled.system, kinds_of(compiled.system), time_grid(spec)
    works = bool(
        any(kind.works for kind in kinds)
        or np.any(system.rows["fun"] >= 0)
        or np.any(system.parts.bodies["damped"])
    )
    stiff = any(kind.is_stiff(system.kinds[kind.name]) for kind in kinds)
    static = system.kinds.get(STATIC_MODES.name)
    newton = _NEWTON if integrator.order < _HIGH_ORDER else _NEWTON_OF_HIGH_ORDER
    return method.Settings(
        start=0.0,
        end=spec.duration,
        interval=grid.interval,
        step=grid.step,
        tolerance=0.0 if grid.step else local_tolerance(spec, integrator),
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
        follow=int(
            static is not None and (integrator.stages > 0 or bool(static.kinetostatic.any()))
        ),
    )


def set_least_motion(
    compiled: Compiled, integrator: method.Method, settings: method.Settings, state: State
) -> None:
    """Set motion and speed of all coordinates to what is rest or round-off.

    Round-off grows with the distance from the origin; a share of the size of the part of the
    model that shares equations, so that what else moves, and where it stands, has no say. A part
    that is driven is as large as the radius of gyration of its bodies at least: where they all
    stand at one point the first motion would be resolved down to the round-off of the driver.
    """
    system = compiled.system
    bodies, markers, weights = system.parts.bodies, system.parts.markers, system.weights
    of = parts_of_model(compiled)
    spread, mass = np.trace(bodies["S0"], axis1=1, axis2=2), bodies["mass"]
    gyration = np.sqrt(np.divide(spread, mass, out=np.zeros(len(mass)), where=mass > 0.0))
    arms, on = np.zeros(len(bodies)), markers["body"] >= 0
    reach = np.linalg.norm(markers["rho"] + markers["arm"], axis=1)
    np.maximum.at(arms, markers["body"][on], reach[on])
    ends = system.rows[system.rows["fun"] >= 0]
    driven = bodies["iv"][[b for end in "IJ" for b in markers["body"][ends[end]] if b >= 0]]
    n = int(system.kkt.panels["nc"].sum()) + 1
    low, high, wide = np.full((n, 3), np.inf), np.full((n, 3), -np.inf), np.zeros((n, 1))
    for body, arm, turns in zip(bodies, arms, gyration, strict=True):
        r, own = state.q[body["iq"] : body["iq"] + 3], of[body["iv"] : body["iv"] + 3]
        low[own], high[own] = np.minimum(low[own], r - arm), np.maximum(high[own], r + arm)
        wide[own] = np.maximum(wide[own], turns * np.isin(own, of[driven])[:, None])
    size = np.maximum(high - low, wide).max(axis=1)[of] * weights
    away = np.maximum(abs(low), abs(high)).max(axis=1)[of] * weights
    for iv, m in zip(bodies["iv"], bodies["m"], strict=True):
        size[iv + 3 : iv + 6] = away[iv + 3 : iv + 6] = 1.0
        for x in (size, away):  # a weighted mode moves points of the body, as its frame does
            x[iv + 6 : iv + 6 + m] = x[iv]
    first = len(weights) - len(system.parts.coordinates)
    size[first:] = away[first:] = _STATE
    noise = _SOLVED if integrator.collocation else _NOISE
    state.motion[:] = np.maximum(
        _SHARE_AT_REST * settings.least_motion * size, noise / settings.tolerance * away
    )
    state.speed[:] = _FASTER / (settings.end - settings.start) * state.motion


def scout_settings(settings: method.Settings, integrator: method.Method) -> method.Settings:
    """Of the scout of a run: the tolerance that its longer steps leave."""
    looser = refinement(integrator) ** integrator.error_order * settings.tolerance
    return settings._replace(tolerance=looser)


def fine_settings(settings: method.Settings, integrator: method.Method) -> method.Settings:
    """Of a run that follows the steps of its scout; its own estimate is a safeguard only."""
    finer = refinement(integrator)
    rings = finer**integrator.error_order if integrator.order < _HIGH_ORDER else 1.0
    return settings._replace(refinement=finer, slack=_SLACK[integrator.stages > 0] * rings)


class Integration:
    """One integration: tables, state, scratch and room for the rows of one chunk.

    Parameters
    ----------
    compiled, integrator, settings, state : Compiled, Method, Settings, State
        What is integrated, how, and where it begins.
    times : (n,) array, optional
        Times of all outputs [s]; `settings.interval` apart by default.
    plan : Plan, optional
        Of the run to be followed; else this one writes its own.
    """

    def __init__(
        self,
        compiled: Compiled,
        integrator: method.Method,
        settings: method.Settings,
        state: State,
        times: np.ndarray | None = None,
        plan: Plan | None = None,
    ) -> None:
        self.compiled, self.method = compiled, integrator
        self.settings, self.state = settings, state
        if settings.step == 0.0 and not state.motion.any():
            set_least_motion(compiled, integrator, settings, state)
        self.times = equal_times(settings) if times is None else times
        channels = len(compiled.layout.channels)
        self.work: Work = new_work(compiled.system, channels, integrator)
        stages = max(integrator.stages, 1)
        self.chunk = max(_MIN_CHUNK, _CHUNK_WORK // (compiled.layout.nv * stages))  # steps
        self.plan = new_plan(self.chunk) if plan is None else plan
        self.rows = ChunkRows(compiled, self._max_rows())
        run = new_run(
            compiled.system, state, self.work, integrator, settings, self.plan, self.rows.output,
            self.times,
        )  # fmt: skip
        self._run, self._output_run = hand_over(run), hand_over(output_run(run))
        self._checkpoint: tuple[int, float, float] | None = None  # steps, time, steps at the limit

    def count_outputs(self) -> None:
        """Count the outputs until the time of the state, which may be of a run with other ones."""
        if not self.state.count[0]["outputs"]:
            return  # it has not begun
        until = self.state.t[0] + method.round_off(self.settings)
        self.state.count["outputs"] = np.searchsorted(self.times, until, side="right")

    def tallies(self) -> dict[str, np.ndarray]:
        """What all rows so far tell, to be saved and filled in again."""
        return {"largest_drift": self.rows.largest_drift, "balance": self.rows.balance.tally}

    def _max_rows(self) -> int:
        """Outputs of one chunk at most; room for a few of them at least."""
        settings, most = self.settings, max(8, _CHUNK_WORK * 10 // self.compiled.layout.nq)
        every = settings.interval / settings.step if settings.step else 1.0
        rows = min(math.ceil(self.chunk / every) + 1, len(self.times), most)
        return max(rows, self._max_rows_of_step()) + 4

    def _max_rows_of_step(self) -> int:
        """The largest number of outputs within a fixed step."""
        if not self.settings.step:
            return 0
        ends = self.times + self.settings.step * (1.0 + 1e-5)
        return int((np.searchsorted(self.times, ends) - np.arange(len(self.times))).max(initial=0))

    @property
    def share_done(self) -> float:
        """How much of the time span is done."""
        start, end = self.settings.start, self.settings.end
        return 1.0 if self.finished else float((self.state.t[0] - start) / (end - start))

    @property
    def finished(self) -> bool:
        """Whether the run has reached its end."""
        settings = self.settings
        return bool(self.state.t[0] >= settings.end - round_off(settings))

    def integrate(self, steps: int) -> int:
        """Run some steps, or with 0 report the present state; returns the status.

        Raises
        ------
        FlexmbError
            Steps under error control have become so short that the run would not end.
        """
        if self.settings.step == 0.0:
            self._refuse_endless()
        self.rows.clear()
        return entries.integrate(self._run, steps, self._output_run)

    def _refuse_endless(self) -> None:
        """Stop a run whose rest would take far too many steps."""
        done, t = int(self.state.count[0]["steps"]), float(self.state.t[0])
        stiff = float(self.state.memory[0]["steps_at_stability_limit"])
        if self._checkpoint is None:
            self._checkpoint = done, t, stiff
        steps, passed = done - self._checkpoint[0], t - self._checkpoint[1]
        if steps < _CHECK_EVERY:
            return
        limited = stiff - self._checkpoint[2] > _STIFF_SHARE * steps
        self._checkpoint = done, t, stiff
        left = (self.settings.end - t) / passed * steps if passed > 0.0 else math.inf
        most, work = _MAX_STABLE_STEPS if limited else _MAX_STEPS
        static = static_modes_sentence(self.compiled, self.method, beside_dynamic=True)
        most = _MAX_STATIC_STEPS if static else most
        if left > min(most, work / (self.compiled.layout.nv * max(self.method.stages, 1))):
            raise FlexmbError(_endless(t, passed / steps, left, limited, static))


def first_steps(own: Integration, begin: State) -> Iterator[OutputBlock]:
    """Rows of the fixed steps about the first output after the start, at each of them.

    Steps between outputs are not seen else; where outputs are rare the motion begun is long gone.
    """
    settings = own.settings
    last = round((settings.end - settings.start) / settings.step)
    first = round((own.times[1] - settings.start) / settings.step) if len(own.times) > 1 else last
    steps = np.arange(max(first - 1, 0), min(first + _RINGING_STEPS, last + 1))
    if first < own.chunk:
        state = State(*(array.copy() for array in begin))
        times = settings.start + settings.step * steps
        run = Integration(own.compiled, own.method, settings, state, times)
        run.integrate(int(steps[-1]))
        yield run.rows.read()


def _endless(t: float, step: float, left: float, limited: bool, static: str) -> str:
    where = (
        f"at t = {t:.6g} s steps of {step:.2g} s leave {left:.2g} of them for the rest of the run"
    )
    if static:
        return f"{where}: {static}"
    if limited:
        return (
            f"{where}: stability of an explicit method limits them, not accuracy; "
            'method = "radau" has no such limit'
        )
    return (
        f"{where}: look for a singular pose, or forces that jump again and again; ask for less "
        "accuracy, or try another method or a fixed step"
    )


def static_modes_sentence(
    compiled: Compiled, integrator: method.Method, beside_dynamic: bool = False
) -> str:
    """The sentence for bodies with quasi-static modes that a method cannot solve for, or "".

    Of an explicit method, with `beside_dynamic` for those alone that have dynamic modes too, and
    are joined.
    """
    static = compiled.system.kinds.get(STATIC_MODES.name)
    if static is None:
        return ""
    if integrator.stages == 0:
        return _unsettled(compiled, static.rows[static.kinetostatic == 1])
    rows = static.rows
    if beside_dynamic:
        markers, system = compiled.system.parts.markers, compiled.system
        ends = np.concatenate([system.rows["I"], system.rows["J"]])
        joined = np.isin(rows, markers["body"][ends[ends >= 0]])
        rows = rows[(static.kinetostatic == 0) & joined]
    if not len(rows):
        return ""
    names = ", bodies.".join(compiled.layout.bodies[row].name for row in rows)
    return (
        f"modes of bodies.{names} are quasi-static, which explicit methods cannot do where joints "
        f'need their compliance: use method = "{entries.STIFF_METHOD}"'
    )


def stiff_force_sentence(run: Integration) -> str:
    """The sentence for a body whose quasi-static modes Newton's method leaves behind, or "".

    They have no inertia, so that no step is small against a force that sets in with them.
    """
    static = run.compiled.system.kinds.get(STATIC_MODES.name)
    names = [run.compiled.layout.bodies[row].name for row in static.rows] if static else []
    body = entries.worst_place(run.compiled, run.work).removeprefix("body ")
    if run.method.collocation > 0 or body not in names:
        return ""
    return (
        f"bodies.{body}: a force that sets in with the deformation, such as a stiff stop's, is too "
        f'stiff for its quasi-static modes; use method = "{entries.STIFF_METHOD}", or deformation '
        '= "dynamic"'
    )


def _unsettled(compiled: Compiled, rows: np.ndarray) -> str:
    """The sentence for kinetostatic bodies whose loads follow their deformation too stiffly."""
    if not len(rows):
        return ""
    names = ", bodies.".join(compiled.layout.bodies[row].name for row in rows)
    return (
        f"bodies.{names}: loads that depend on the deformation, such as a stiff stop's, do "
        'not settle with quasi-static modes; deformation = "automatic" has them'
    )
