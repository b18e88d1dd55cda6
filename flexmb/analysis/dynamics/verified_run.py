"""A run and its scout, the same run with longer steps, which advance together.

The scout selects its steps by error control; the fine run, whose rows are the result, takes
`refinement` times as many, spread as the scout's were, so that the errors of both differ by a
factor that is clear beforehand. Both advance chunk by chunk; of the scout nothing is saved but its
state at the border of a chunk, and kept are its steps and what is compared.

A chaotic motion multiplies whatever error there is by a factor in each time of its own (Lyapunov's
exponent; Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I, 1993, §I.16). Errors
of the method fall with the steps, round-off does not, and the difference of a run and its scout
tells nothing of it once it is divided by the ratio of their errors. So the scout is run again where
its differences grew as by such a factor, on its own steps moved by a billionth, to and fro. These
runs have the same errors of the method, but not of round-off.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexmb.analysis.dynamics.compared_quantities import (
    NO_MOTION,
    RoundOff,
    RowComparison,
    by_part,
    compared,
)
from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.jump_states import JumpStates
from flexmb.analysis.dynamics.measured_error import MeasuredError, QuantityError
from flexmb.analysis.dynamics.run_settings import (
    damps_vibrations,
    fine_settings,
    gyration,
    modal_reach,
    scout_rows,
    scout_settings,
)
from flexmb.engine import method
from flexmb.engine.allocation import new_plan
from flexmb.engine.compile import Compiled
from flexmb.engine.state import Plan, State
from flexmb.errors import FlexmbError
from flexmb.model.model import Model
from flexmb.progress import Progress
from flexmb.results.output_block import OutputBlock

_SCOUT = "scout_"
_SPUN = 0.1  # radians for each of those by which the first speeds turn a body within the run
# Ratio of errors where vibrations are damped: they move a sensor as the square of their period.
_DAMPED_RATIO = 2.6
# Difference of a pass below which that of the next one is compared with it; least share of the
# order that two passes may show.
_SAME_MOTION, _MIN_ORDER = 0.05, 0.5
_MORE_STEPS = 1.1  # of a scout over those of the pass before, from which on their order is told
# Of radau with states: if stiff, order 3 of a stage is left of 5 (Hairer & Wanner II, §IV.15). With
# 2, 1.5, 0.75, 0 of 66 runs of states miss the request 0, 1, 1, 1, are told less than a third 0, 1,
# 3, 3, more than 3 times 5, 2, 4, 0, at cost 1.09, 1, 0.94, 0.93; of 16 with slow states 7 with 2.
_ORDER_LOST = {True: 2.0, False: 1.5}
# The ratio of errors of an explicit method may be this many times larger or smaller by the pass
# before than by its order. Measured over the expected one: of 200 first passes a tenth had 0.8 or
# less, half 1.2, a tenth 2.7 or more (order 8; 0.9, 1.1, 2.6 with order 5). From pass to pass
# errors fell by 0.54 of the expected factor or less in a twentieth of 184 pairs (0.59): only below
# is order lost.
_LUCK = 2.0
_FOLLOWING = 3.0  # order of positions where modes follow their loads, by cubics through their past
_LIMITED = 0.02  # of all steps, those of a scout at its limit of stability
# Of a step that a knot of the plan is moved; ratio of steps that are even.
_MOVED, _EVEN = 1e-9, 2.0
_ANY_ERROR = 1e6  # of its steps over what the scout allows, which has taken them
# Share of the requested accuracy that a bound of multiplied round-off exceeds before it is
# measured; what one run shows before it is measured by three, of which none had to find its steps.
# Times the bound by growth is exceeded: up to 70 by explicit methods, 1000 by radau (chains of
# pendulums, near the origin and 1 km away).
_SUSPECTED, _SHOWN, _EXCEEDED = 0.1, 0.01, {True: 100.0, False: 1000.0}
_LONGER = 1.1  # steps of the repeated scout over its own, beyond which it is no repetition


class Chunk(NamedTuple):
    """Times at which the steps of a scout began and ended [s], and values compared in its rows."""

    knots: np.ndarray
    values: np.ndarray  # (k, components)


class VerifiedRun:
    """Two runs of one model that advance together.

    Attributes
    ----------
    scout, fine : Integration
        The runs; the fine one follows the plan that the scout writes.
    error : MeasuredError
        Their difference so far.
    recorded, of_scout : (n,) array of bool
        Which of the times of the fine run are outputs, and at which it is compared with the scout.
    passes : array
        Record `PASSES` of the run.
    is_stiff : bool
        Whether stability limited the steps of an explicit method.
    jumps : JumpStates, optional
        Of the fine run, where something is stiff.
    """

    def __init__(
        self, scout: Integration, fine: Integration, error: MeasuredError, recorded: np.ndarray,
        of_scout: np.ndarray, passes: np.ndarray, is_stiff: bool, jumps: JumpStates | None,
    ) -> None:  # fmt: skip
        self.scout, self.fine, self.error, self.passes = scout, fine, error, passes
        self.recorded, self.of_scout, self.is_stiff = recorded, of_scout, is_stiff
        self.jumps = jumps
        self.chunks: list[Chunk] = []  # of the scout, of a resumed run from there on

    @property
    def difference(self) -> float:
        """Largest difference of positions, over their peak-to-peak."""
        largest = self.error.largest(2.0)
        return largest["positions"].error if "positions" in largest else 0.0

    @property
    def order(self) -> float:
        """That of the method, or less, where the difference fell less since the pass before.

        By the steps of both scouts: where these lock to a swing, a stricter tolerance gives hardly
        more. Not where they were different motions.
        """
        integrator, passes, now = self.fine.method, self.passes[0], self.difference
        highest = float(integrator.order)
        implicit = integrator.stages == 0 and integrator.order >= method.HIGH_ORDER
        if implicit and self.fine.compiled.layout.coordinates:
            highest -= _ORDER_LOST[self.is_stiff]
        if self.fine.settings.static_after_step == 1:
            highest = min(highest, _FOLLOWING)
        steps, last = self.scout.state.count[0]["steps"], passes["last_steps"]
        known = 0.0 < passes["last_difference"] < _SAME_MOTION and now > 0.0
        if not known or steps < _MORE_STEPS * last:
            return highest
        scatter = _LUCK if integrator.stages else 1.0
        order = math.log(scatter * passes["last_difference"] / now) / math.log(steps / last)
        return min(max(order, min(_MIN_ORDER * integrator.order, highest)), highest)

    @property
    def ratio(self) -> float:
        """Error of the scout over that of the fine run, which may add steps where it needs them."""
        fine, scout = (run.state.count[0]["steps"] for run in (self.fine, self.scout))
        finer = min(max(fine / max(scout, 1), 1.0), self.fine.settings.refinement)
        return float(finer**self.order)

    @classmethod
    def of(
        cls, compiled: Compiled, model: Model, integrator: method.Method, settings: method.Settings,
        first: State, times: np.ndarray, recorded: np.ndarray, passes: np.ndarray, is_stiff: bool,
        jumps: JumpStates | None,
    ) -> VerifiedRun:  # fmt: skip
        """A run from a copy of a state, and its scout, at the local tolerance of the settings.

        `recorded` says which of the times (n,) of the run are outputs; those of `jumps` are among
        them.
        """
        states = [State(*(array.copy() for array in first)) for _ in range(2)]
        of_scout = scout_rows(len(times), bool(compiled.system.events))
        scout = Integration(
            compiled, integrator, scout_settings(settings, integrator), states[0], times[of_scout]
        )
        fine = Integration(
            compiled, integrator, fine_settings(settings, integrator), states[1], times, scout.plan
        )
        length, span = compiled.length, settings.end - settings.start
        spun = (np.abs(first.v[body.iv + 3 : body.iv + 6]).max() for body in compiled.layout.bodies)
        turn = max(1.0, _SPUN * span * float(max(spun, default=0.0)))
        least = {"m": length, "rad": turn, "m/s": length / span, "rad/s": turn / span}
        at_rest = {unit: NO_MOTION * size for unit, size in least.items()}
        radii, modes = gyration(compiled), modal_reach(compiled)
        parts = by_part(compared(compiled.layout, model, modes), compiled, model)
        comparison = RowComparison(compiled.layout, model, at_rest, span, radii, parts, modes)
        error = MeasuredError(comparison, RoundOff(comparison.compared, compiled, model))
        return cls(scout, fine, error, recorded, of_scout, passes, is_stiff, jumps)

    def advance(self, first: bool = False) -> tuple[int, list[OutputBlock]]:
        """One chunk of both, or the first row; returns the status, and the rows of the fine run."""
        scout, fine = self.scout, self.fine
        status = scout.integrate(0 if first else scout.chunk)
        coarse = scout.rows.read()
        rows: list[OutputBlock] = []
        done = 0
        knots = scout.plan.knots[: scout.plan.used[0]].copy()
        end = knots[-1]
        self.chunks.append(Chunk(knots, self.error.comparison.values(coarse)))
        while first or fine.state.t[0] < end:
            fine_status = fine.integrate(0 if first else fine.chunk)
            block = fine.rows.read()
            if self.jumps is not None:
                self.jumps.add_rows(block)
                self.jumps.add_events(fine.events())
            both = block.rows(self._newest(self.of_scout, block))
            self.error.add(coarse.part(done, done + len(both.t)), both)
            done += len(both.t)
            rows.append(block.rows(self._newest(self.recorded, block)))
            if first or fine_status != method.SUCCESS:
                status = max(status, fine_status)
                break
        if self.jumps is not None:
            self.jumps.add_steps(knots, fine.settings.refinement)
        return status, rows

    def _newest(self, which: np.ndarray, block: OutputBlock) -> np.ndarray:
        """Of rows of the fine run, those of its newest block."""
        behind = int(self.fine.state.count[0]["outputs"])
        return which[behind - len(block.t) : behind]

    def arrays(self) -> dict[str, np.ndarray]:
        """All that a resumed run needs in addition to the state of the fine run."""
        return {
            **{_SCOUT + name: value for name, value in self.scout.state._asdict().items()},
            **self.error.arrays(),
            **({} if self.jumps is None else {"jumps": self.jumps.table}),
        }

    def errors(self) -> dict[str, QuantityError]:
        """The measured error of each quantity.

        Vibrations that the longer steps damp are damped by the shorter ones too, but for a band
        between, which may be all that a small sensor sees: no balance of energies tells.
        """
        damped, ratio = damps_vibrations(self.fine.compiled, self.fine.method), self.ratio
        damped |= self.fine.settings.static_after_step == 1
        if 0.0 < self.passes[0]["last_difference"] < _SAME_MOTION:
            luck = _LUCK if self.fine.method.stages else 1.0
            ratio = min(self.error.ratio_before() or ratio, luck * ratio)
        ratio = min(ratio, _DAMPED_RATIO) if damped else ratio
        return self.error.largest(ratio, int(self.fine.state.count[0]["steps"]), self.is_limited)

    @property
    def is_limited(self) -> bool:
        """Whether stability limits steps of the scout."""
        steps, memory = self.fine.state.count[0]["steps"], self.scout.state.memory[0]
        return bool(memory["steps_at_stability_limit"] > _LIMITED * steps)

    def statistics(self) -> dict[str, float | int | str]:
        """What the summary of a run says of its error."""
        statistics: dict[str, float | int | str] = {
            "accuracy_asked": self.fine.settings.accuracy,
            "passes": int(self.passes[0]["count"]),
            "scout_steps": int(self.scout.state.count[0]["steps"]),
        }
        for quantity, worst in self.errors().items():
            if quantity in ("positions", "velocities", "reactions"):
                statistics[f"measured_error_of_{quantity}"] = worst.error
                statistics[f"worst_of_{quantity}"] = f"{worst.name} at t = {worst.time:.4g} s"
                if worst.over:
                    statistics[f"scale_of_{quantity}"] = worst.over
        return statistics


def measure_round_off_growth(
    verified: VerifiedRun, accuracy: float, begin: State, progress: Progress
) -> None:
    """Let the measured error of a run know of round-off that its motion multiplies.

    Parameters
    ----------
    verified : VerifiedRun
        The run and its scout, at their end.
    accuracy : float
        The requested one. Where it is not reached, the cause is looked for in any case.
    begin : State
        Where it began.
    progress : Progress
        Called for every chunk.
    """
    error, scout = verified.error, verified.scout
    steps = int(scout.state.count[0]["steps"])
    exceeded = _EXCEEDED[verified.fine.method.stages > 0]
    bound = exceeded * np.sqrt(steps) * error.round_off_share() * error.growth()
    worst = verified.errors().get("positions")
    suspected = bound > _SUSPECTED * accuracy and not verified.is_limited
    if worst is None or not (suspected or worst.error > accuracy):
        return
    try:
        chunks = verified.chunks
        if not chunks or chunks[0].knots[-1] > scout.settings.start:  # of a resumed run
            chunks = _repeated_chunks(verified, begin, progress)
        runs = [_follow(verified, begin, chunks, _MOVED, progress)]
        more = verified.fine.settings.refinement
        error.set_round_off([np.vstack([chunk.values for chunk in chunks]), *runs], more)
        if error.amplified_round_off() > _SHOWN * accuracy:
            runs += [_follow(verified, begin, chunks, shift, progress) for shift in (-_MOVED, 0.0)]
            error.set_round_off(runs, more)
    except FlexmbError:  # too many steps: the run itself has told
        return
    finally:
        error.drop_unamplified_round_off(steps)


def _repeated_chunks(verified: VerifiedRun, begin: State, progress: Progress) -> list[Chunk]:
    """The chunks of a scout from its start, as far as it can be repeated."""
    scout, chunks = verified.scout, list[Chunk]()
    own = _again(scout, scout.settings, begin)
    most = _LONGER * scout.state.count[0]["steps"]
    while not chunks or not own.finished:
        status = own.integrate(own.chunk if chunks else 0)
        knots, values = (
            own.plan.knots[: own.plan.used[0]],
            verified.error.comparison.values(own.rows.read()),
        )
        chunks.append(Chunk(knots.copy(), values))
        if status != method.SUCCESS or own.state.count[0]["steps"] > most:
            break
        progress("integrate", 1.0, f"measures round-off, t = {own.state.t[0]:.4g} s")
    return chunks


def _again(
    scout: Integration, settings: method.Settings, begin: State, plan: Plan | None = None
) -> Integration:
    """The scout from its start."""
    state = State(*(array.copy() for array in begin))
    return Integration(scout.compiled, scout.method, settings, state, scout.times, plan)


def _follow(
    verified: VerifiedRun, begin: State, chunks: list[Chunk], shift: float, progress: Progress
) -> np.ndarray:
    """Values compared (k, components) in the rows of a run on the scout's steps, moved by a share
    of them, as far as it comes."""
    scout, rows = verified.scout, list[np.ndarray]()
    settings = scout.settings._replace(refinement=1.0, rejection_factor=_ANY_ERROR)
    run = _again(scout, settings, begin, new_plan(scout.chunk))
    for chunk in chunks:
        _put_plan(run, chunk.knots, shift)
        status = method.SUCCESS
        while not rows or (status == method.SUCCESS and run.state.t[0] < chunk.knots[-1]):
            status = run.integrate(run.chunk if rows else 0)
            rows.append(verified.error.comparison.values(run.rows.read()))
        if status != method.SUCCESS:
            break
        progress("integrate", 1.0, f"measures round-off, t = {run.state.t[0]:.4g} s")
    return np.vstack(rows)


def _put_plan(run: Integration, knots: np.ndarray, shift: float) -> None:
    """Let a run follow knots, those between even steps moved to and fro by a share of them.

    Not those at which functions change their laws, or about events, where steps begin again.
    """
    n, events, plan = len(knots), run.compiled.system.time_events.ravel(), run.plan
    plan.used[0], plan.knots[:n] = n, knots
    steps, inner = np.diff(knots), knots[1 : n - 1]
    ratios = steps[1:] / steps[:-1]
    regular = (ratios > 1.0 / _EVEN) & (ratios < _EVEN)
    edges = np.concatenate([[-np.inf], events, [np.inf]])
    after = np.searchsorted(edges, inner)
    regular &= np.minimum(inner - edges[after - 1], edges[after] - inner) > _MOVED * steps[:-1]
    signs = np.where(np.arange(len(inner)) % 2, shift, -shift)
    plan.knots[1 : max(n - 1, 1)] += np.where(regular, signs * steps[:-1], 0.0)
