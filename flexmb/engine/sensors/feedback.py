"""Feedback: functions of measured channels that act as forces, or as rates of states.

The stage evaluates the channels that these functions use at the present state, including
accelerations and multipliers, and then the functions. Their values go to the rows of
Constraints.fun that loads and scalar coordinates read. Angles that count turns are those nearest to
the last accepted state.

Tangents are rank-one blocks −u (∂f/∂m) (∂m/∂q, ∂m/∂v)ᵀ of the iteration matrix. u is the
generalised force per unit of f: of a component of a load, of the force on a scalar coordinate, or
of the rate of a state. There is one block for each u and each body or state on which the channel m
depends. ∂f/∂m is the first derivative of the program with the rate of the channel m set to one.
∂m/∂q has two parts: the gradient with respect to the motion of the markers and, for velocities, the
change of their moment arms at constant v. The tangents are exact for positions, velocities and
states. Of accelerations only the dependence on v̇ is included; Newton's method converges without
their dependence on positions, and without that of reactions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import clear
from flexmb.engine.bodies import wrench
from flexmb.engine.bodies.wrench import add_generalized_force
from flexmb.engine.equations_of_motion import bias_stage, velocity_stage
from flexmb.engine.function import count_switches, put_switches, run_program
from flexmb.engine.jit import Integers, array_of, call_channel, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.sensors import CHANNEL_KINDS, MEASURES
from flexmb.engine.sensors.sensor import channel_value
from flexmb.engine.state import Point, Run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexmb.engine.bodies.marker import MarkerTable
    from flexmb.engine.lowering import Lowering
    from flexmb.engine.symbolic import Symbolic
    from flexmb.engine.tables import Functions, Sensors
    from flexmb.model.control import State

_I = "i8"
_VELOCITY, _ACCELERATION = 1, 2  # levels of measures: order of the time derivative they contain

# One partial derivative ∂f/∂m that the tangents need: of a program with respect to a channel.
PARTIAL = np.dtype([("program", _I), ("channel", _I)], align=True)
# One rank-one block of the iteration matrix. The function acts on component `a` of row `row` at its
# marker J or I (`on` 0, 1), of the element kind `kind` among those with a unit force; or, for
# kind = -1, on the scalar coordinate with velocity `iv`. The channel depends on `term` at its
# marker I or J (`side` 0, 1), or on the state with velocity `state`. `panel`: that of the
# coordinates on which the function acts; `link`: LINK of the two sets of coordinates, -1 if they
# are the same.
_WORDS = "partial kind row on a iv panel term side state link"
FEEDBACK_TANGENT = np.dtype([(word, _I) for word in _WORDS.split()], align=True)


class Feedback(NamedTuple):
    """Functions of measured channels that act as forces or drive states."""

    programs: Integers  # (k,) their programs in `System.functions`
    channels: Integers  # (n,) channels that they read
    partials: array_of(PARTIAL)
    tangents: array_of(FEEDBACK_TANGENT)
    implicit: int  # 1: some of them depend on accelerations or reactions
    first_event: int  # index of the event function of their first switch


@unit
def evaluate_functions(run: Run, feedback: Feedback, at: Point) -> int:
    """Evaluate all functions of channels, after a position stage."""
    velocity_stage(run, at)
    if feedback.implicit == 1:
        bias_stage(run, at)
    channels, programs, t = feedback.channels, feedback.programs, at.t[0]
    functions, fun = run.system.functions, run.work.con.fun
    x, stack = run.work.trial.variables, run.work.trial.stack
    run.work.feedback.t[0] = t
    for k in range(channels.shape[0]):
        c = channels[k]
        x[c, 0] = channel_value(run, at, c)
        x[c, 1], x[c, 2] = 0.0, 0.0
    for k in range(programs.shape[0]):
        p = programs[k]
        fun[p, 0] = run_program(functions, p, t, x, stack)
        fun[p, 1], fun[p, 2] = stack[0, 1], stack[0, 2]
    return SUCCESS


@unit
def put_events(run: Run, feedback: Feedback, at: Point) -> int:
    """Event functions of the switches in all programs, after a velocity stage.

    There are none if a function depends on accelerations or reactions.
    """
    if feedback.implicit == 1:
        return SUCCESS
    evaluate_functions(run, feedback, at)
    trial, n = run.work.trial, feedback.first_event
    for k in range(feedback.programs.shape[0]):
        n = put_switches(
            run.system.functions, feedback.programs[k], at.t[0], trial.variables, trial.stack,
            run.work.events.now, n,
        )  # fmt: skip
    return SUCCESS


@unit
def add_tangents(run: Run, feedback: Feedback, at: Point, cv: float, cp: float) -> int:
    """Add the tangents of all functions of channels to the iteration matrix of a step."""
    if cv == 0.0:
        return SUCCESS
    _put_partial_derivatives(run, feedback)
    tangents, work = feedback.tangents, run.work.feedback
    slopes, right, block = work.slopes, work.right, work.block
    clear(work.rate_terms, 2, work.rate_terms.shape[1])
    for k in range(tangents.shape[0]):
        row = tangents[k]
        slope = slopes[row["partial"]]
        if slope == 0.0:
            continue
        if row["kind"] < 0 and (k == 0 or tangents[k - 1]["partial"] != row["partial"]):
            value = run.work.trial.variables[feedback.partials[row["partial"]]["channel"], 0]
            work.rate_terms[0, row["iv"]] += abs(slope * value)
            work.rate_terms[1, row["iv"]] += abs(slope) if row["state"] == row["iv"] else 0.0
        _put_unit_force(run, row, at)
        if row["state"] >= 0:
            right[0] = cv
            block[2], block[3] = row["state"], 1
        else:
            _put_channel_gradient(run, at, row["term"], row["side"], cv, cp)
        _add_outer_product(run, row["panel"], row["link"], -slope)
    return SUCCESS


@kernel
def _put_partial_derivatives(run, feedback):
    """Partial derivatives ∂f/∂m of the programs; 0 where the derivative is not finite."""
    x, stack, functions = run.work.trial.variables, run.work.trial.stack, run.system.functions
    partials, slopes, t = feedback.partials, run.work.feedback.slopes, run.work.feedback.t[0]
    for k in range(partials.shape[0]):
        p, c = partials[k]["program"], partials[k]["channel"]
        run_program(functions, p, t, x, stack)
        own = stack[0, 1]
        x[c, 1] = 1.0
        run_program(functions, p, t, x, stack)
        slope = stack[0, 1]
        x[c, 1] = 0.0
        slopes[k] = slope - own if math.isfinite(slope - own) else 0.0


@kernel
def _put_unit_force(run, row, at):
    """Put the generalised force per unit of f into feedback.left, and its place into block."""
    kind, work, stage = row["kind"], run.work.feedback, run.stages.unit_force
    if kind < 0:
        left, block = work.left, work.block
        left[0] = 1.0
        block[0], block[1] = row["iv"], 1
    else:
        part = 6 * row["row"] + 3 * row["on"] + row["a"]
        call_channel(stage.units[kind], run, stage.tables[kind], at, part)


@unit
def _put_channel_gradient(run: Run, at: Point, t: int, side: int, cv: float, cp: float) -> int:
    """Put cp ∂m/∂q + cv ∂m/∂v (+ ∂m/∂v̇) of term t on one side into feedback.right, with block."""
    parts, now, work, B = run.system.parts, run.work.now, run.work.feedback, run.work.dense.B
    sensors, right, block, position, velocity = (
        run.system.sensors, work.right, work.block, work.g[0], work.g[1]
    )  # fmt: skip
    term, v = sensors.terms[t], at.v
    clear(work.g, 2, 12)
    call_channel(run.sensors.gradient[term["measure"]], run, sensors, at, t)
    level = run.sensors.level[term["measure"]]
    k, o = term["I"] if side == 0 else term["J"], 6 * side
    body = parts.bodies[parts.markers[k]["body"]]
    n, iv, f = 6 + body["m"], body["iv"], term["factor"]
    block[2], block[3] = iv, n
    for c in range(n):
        right[c] = 0.0
    if level == _ACCELERATION:
        add_generalized_force(parts, now, k, velocity, o, f, right, 0)
        return SUCCESS
    add_generalized_force(parts, now, k, position, o, cp * f, right, 0)
    if level == _VELOCITY:
        add_generalized_force(parts, now, k, velocity, o, cv * f, right, 0)
        clear(B, n, n)
        wrench.add_moment_arm(parts, now, k, velocity, o, cp * f, B)
        for r in range(n):
            for c in range(n):
                right[c] += v[iv + r] * B[r, c]
    return SUCCESS


@kernel
def _add_outer_product(run, panel, link, f):
    """Add f left rightᵀ to the block of two sets of coordinates, or the diagonal block of one."""
    kkt, work, low, up = run.system.kkt, run.work.feedback, run.work.factor.low, run.work.factor.up
    column, left, right, block = kkt.column, work.left, work.right, work.block
    diagonal, early = link < 0, False
    at, stride = kkt.panels[panel]["at"], kkt.panels[panel]["nc"]
    if not diagonal:
        place = kkt.links[link]
        at, stride, early = place["at"], place["stride"], place["flipped"] == 1
    iv, n, jv, m = block[0], block[1], block[2], block[3]
    for r in range(n):
        pr = column[iv + r]
        for c in range(m):
            pc = column[jv + c]
            if pr < 0 or pc < 0:
                continue
            x = f * left[r] * right[c]
            if early or (diagonal and pr <= pc):
                up[at + pc * stride + pr] += x
            if not early and (not diagonal or pr >= pc):
                low[at + pr * stride + pc] += x


FEEDBACK = Kind(
    "feedback",
    Feedback,
    {"feedback": evaluate_functions, "matrix": add_tangents, "events": put_events},
    does_work=True,
    stiff=True,
    # a state in small numbers acts on a body by a large factor, the body on it by a small one
    unsymmetric=lambda feedback: len(feedback.tangents) > 0,
)


class Start(NamedTuple):
    """Initial value of a state: a number, or the value of a function at the begin of the run."""

    iv: int  # velocity coordinate of the state
    value: float
    program: int  # -1: `value` is used


class _Effect(NamedTuple):
    """What a function acts on, as in FEEDBACK_TANGENT; `block`: its set of coordinates."""

    program: int
    kind: int
    row: int
    on: int
    a: int
    iv: int
    block: int


@dataclass
class FeedbackTables:
    """The tables, and the pair of coordinate sets (blocks) that each of their tangents couples."""

    feedback: Feedback
    blocks: list[tuple[int, int]]

    @property
    def couples(self) -> list[tuple[int, int]]:
        """Pairs of different blocks."""
        return [pair for pair in dict.fromkeys(self.blocks) if pair[0] != pair[1]]

    def place(self, symbolic: Symbolic) -> None:
        """Fill in `panel` and `link` of every tangent."""
        for row, pair in zip(self.feedback.tangents, self.blocks, strict=True):
            row["panel"] = symbolic.panel_of[pair[0]]
            row["link"] = symbolic.couple_links.get(pair, -1)


def starts(states: tuple[State, ...], ivs: Mapping[str, int], functions: Functions) -> list[Start]:
    """The initial value of every state."""
    return [
        Start(ivs[state.name], state.start, -1)
        if isinstance(state.start, float)
        else Start(ivs[state.name], 0.0, functions.put(state.start))
        for state in states
    ]


def feedback_tables(
    lowering: Lowering,
    kinds: Sequence[str],
    numbers: Mapping[str, int],
    sensors: Sensors,
    scalars: NDArray[np.void],
) -> FeedbackTables | None:
    """Tables of all functions of channels; None if there are none.

    `kinds`: element kinds through which functions act, in their order; `numbers`: numbers of the
    channels by name. Blocks are numbered as in `symbolic.Blocks`: bodies, then scalar coordinates.
    """
    channels_read = {k: f.channels for k, f in enumerate(lowering.functions.programs) if f.channels}
    if not channels_read:
        return None
    markers = lowering.markers
    partials: list[tuple[int, int]] = []
    tangents: list[tuple[int, ...]] = []
    blocks: list[tuple[int, int]] = []
    for effect in _effects(channels_read, lowering, kinds, scalars):
        for name in channels_read[effect.program]:
            pair = effect.program, numbers[name]
            if pair not in partials:
                partials.append(pair)
            at = partials.index(pair)
            acts = effect.kind, effect.row, effect.on, effect.a, effect.iv
            for term, side, state, block in _sources(
                sensors, numbers[name], scalars, markers, len(markers.bodies)
            ):
                tangents.append((at, *acts, -1, term, side, state, -1))
                blocks.append((effect.block, block))
    switches = sum(count_switches(lowering.functions.programs[k]) for k in channels_read)
    used = sorted({numbers[name] for names in channels_read.values() for name in names})
    feedback = Feedback(
        programs=np.array(list(channels_read), np.int64),
        channels=np.array(used, np.int64),
        partials=np.array(partials, PARTIAL),
        tangents=np.array(tangents, FEEDBACK_TANGENT),
        implicit=int(any(_is_implicit(sensors, c) for c in used)),
        first_event=lowering.add_events(switches),
    )
    return FeedbackTables(feedback, blocks)


def _effects(
    channels_read: Mapping[int, tuple[str, ...]],
    lowering: Lowering,
    kinds: Sequence[str],
    scalars: NDArray[np.void],
) -> Iterator[_Effect]:
    """Everything that functions of channels act on."""
    for action in lowering.actions:
        body = lowering.markers.body(action.marker)
        if action.program in channels_read and body >= 0:
            kind = kinds.index(action.kind)
            yield _Effect(action.program, kind, action.row, action.on, action.a, -1, body)
    for k, scalar in enumerate(scalars):
        if int(scalar["fun"]) in channels_read:
            block = len(lowering.markers.bodies) + k
            yield _Effect(int(scalar["fun"]), -1, -1, 0, 0, int(scalar["iv"]), block)


def _sources(sensors: Sensors, number: int, scalars, markers: MarkerTable, n_bodies: int):
    """(term, side, state, block) of every body and state that a channel depends on."""
    channel = sensors.channels[number]
    reads = CHANNEL_KINDS[channel["what"]].reads
    if reads == "state":
        iv = int(channel["first"])
        yield -1, 0, iv, n_bodies + int(np.flatnonzero(scalars["iv"] == iv)[0])
    elif reads == "terms":
        for k in range(channel["first"], channel["first"] + channel["n"]):
            term = sensors.terms[k]
            for side, marker in enumerate((int(term["I"]), int(term["J"]))):
                body = markers.body(marker) if marker >= 0 else -1
                if body >= 0:
                    yield k, side, -1, body


def _is_implicit(sensors: Sensors, number: int) -> bool:
    """Whether a channel depends on accelerations, or on reactions and other forces."""
    channel = sensors.channels[number]
    reads = CHANNEL_KINDS[channel["what"]].reads
    if reads == "terms":
        terms = sensors.terms[channel["first"] : channel["first"] + channel["n"]]
        return any(MEASURES[term["measure"]].level == 2 for term in terms)
    return reads in ("forces", "channels")
