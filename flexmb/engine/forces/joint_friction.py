"""Friction in joints, on a scalar coordinate without mass that follows the joint's.

The normal force N comes from the joint's reaction on J in the axes of I. A bearing of length L
carries the lateral force F and the bending moment M as two forces at its ends,
R₁,₂ = F/2 ± (M × z)/L, so N = |R₁| + |R₂|; a guide of width w carries a torque T about its axis
with |T|/w more; a preload adds to it. Of the reaction counts what stretches a bristle by more than
the round-off of its place: joints without load have no friction. N belongs to the multipliers of
the iterate; its slope over them stands in the unsymmetric iteration matrix, while reported
accelerations are iterated for. Where friction grows as fast as the forces that cause it, neither
settles: the joint locks itself. How fast the limit μ N/k of a bristle grows follows from R₁, R₂ and
T of the last three steps: by the slopes of their parabolas, or of lines behind what bends.
Source of the bearing's share: Haug, Wu & Yang, Mech. Mach. Theory 21 (1986) 401.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import turned_back
from flexmb.engine.forces.friction import (
    BRISTLE,
    FREE,
    FRICTION_FIELDS,
    FULL,
    LEAST_EXCESS,
    friction_coefficient,
    friction_parameters,
    line_friction,
)
from flexmb.engine.jit import Matrix, array_of, kernel, unit
from flexmb.engine.joints.constraint import put_group_wrench
from flexmb.engine.joints.row import put_row_gradient
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import BRISTLE_ENERGY, DAMPER_POWER, Point, Run

if TYPE_CHECKING:
    from flexmb.engine.lowering import Forces, Lowering, Placement

_I, _F = "i8", "f8"
# Friction in a joint, on a scalar coordinate s that follows the joint's; the surface moves by
# radius times s. It remembers where its bristle is free (m), and whether it is full.
JOINT_FRICTION = np.dtype(
    [
        ("group", _I),  # of the joint
        ("coordinate", _I),
        ("link", _I),  # LINK of the joint's rows with the coordinate
        ("axis", _I),  # of marker I, along which or about which it moves
        ("radius", _F),  # m, or 1 of a stroke
        ("length", _F),  # of the bearing, m; 0: it bears no moment
        ("width", _F),  # of the guide, m; 0: it bears no torque about its axis
        ("preload", _F),  # N
        *FRICTION_FIELDS,
    ],
    align=True,
)


# Friction of one joint now, on the surface of its pin or guide: force (N), bristle (m), |T| − μ N,
# k |s| − μ N were it free, slopes of −force over position, speed and bearing load, position (m).
_WORDS = ("force", "bristle", "excess", "room", "stiffness", "damping", "load", "position")
SURFACE = np.dtype([(word, _F) for word in _WORDS], align=True)


class Scratch(NamedTuple):
    load: Matrix  # (n, 2) bearing load, from the multipliers, and force of friction, N
    bearing: Matrix  # (n, 5) R₁ and R₂ (2 each) and T/w of it, N
    surface: array_of(SURFACE)  # (1,) the friction that was evaluated last


class JointFrictions(NamedTuple):
    """Frictions in joints of a model."""

    rows: array_of(JOINT_FRICTION)
    first_event: int  # each has two: what makes it slide or stick, the length of its bristle
    scratch: Scratch = None  # of one run


# Places of history of one friction: where its bristle is free, whether it is full (±FULL); rate of
# the bearing load, time between the last step and the one before (0: unknown; < 0: that is the
# first), and R₁, R₂ and T/w at both.
_ANCHOR, _MODE, _RATE, _SPAN, _LAST, _EARLIER, _HISTORY = 0, 1, 2, 3, 4, 9, 14
_PARTS = 5


def lower_joint_frictions(lowering: Lowering, forces: Forces) -> JointFrictions:
    """JOINT_FRICTION rows of all frictions in joints; `link` is filled in later."""
    groups = lowering.groups
    rows: list[tuple[object, ...]] = []
    for name, spec in forces:
        group, k = groups.numbers[f"joints.{spec.joint}"], lowering.coordinate(f"forces.{name}")
        stroke = not lowering.scalars[k].angular
        rows.append(
            (
                group, k, -1, 0 if stroke and lowering.model.plane is not None else 2,
                1.0 if stroke else spec.radius, spec.length or 0.0, spec.width or 0.0,
                spec.preload, *friction_parameters(spec), lowering.add_history(_HISTORY),
            )
        )  # fmt: skip
        lowering.reaction_loads.append((group, k))
        lowering.markers.framed.add(groups.in_group(group)[0].I)  # the reaction is read in its axes
    return JointFrictions(np.array(rows, JOINT_FRICTION), lowering.add_events(2 * len(rows)))


def place_joint_frictions(frictions: JointFrictions, placement: Placement) -> None:
    """Where the coordinate of each friction stands in the matrix with the rows of its joint."""
    links, first = placement.symbolic.coordinate_links, placement.n_bodies
    for row in frictions.rows:
        row["link"] = links[int(row["group"]), first + int(row["coordinate"])]


# Speed over that of creeping by which smooth friction stays clear of its event.
_EVENT_CLEARANCE = 1e-3


@unit
def evaluate_surface(run: Run, frictions: JointFrictions, at: Point, k: int) -> float:
    """Friction k for place and rate of its coordinate, into `surface` (`line_friction`).

    Returns the bristle, m.
    """
    f, out, history = frictions.rows[k], frictions.scratch.surface[0], run.work.now.history
    s, o = run.system.parts.coordinates[f["coordinate"]], f["history"]
    x, rate = f["radius"] * at.q[s["iq"]], f["radius"] * at.v[s["iv"]]
    force, bristle, excess, room, stiffness, damping, load = line_friction(
        f, frictions.scratch.load[k, 0], x - history[o + _ANCHOR], rate, history[o + _MODE]
    )
    out["force"], out["bristle"], out["excess"], out["room"] = force, bristle, excess, room
    out["stiffness"], out["damping"], out["load"], out["position"] = stiffness, damping, load, x
    return bristle


@kernel
def _bearing(run, f, w):
    """The forces R₁ and R₂ across the axis (2 each), and T/w, of the wrench w on J."""
    sys = run.system
    R = run.work.now.marker[sys.rows[sys.groups[f["group"]]["row"]]["I"]]["R"]
    F = turned_back(R, (w[6], w[7], w[8]))
    M = turned_back(R, (w[9], w[10], w[11]))
    a, b = (f["axis"] + 1) % 3, (f["axis"] + 2) % 3
    x, y, u, v, turn = 0.5 * F[a], 0.5 * F[b], 0.0, 0.0, 0.0
    if f["length"] > 0.0:
        u, v = M[b] / f["length"], -M[a] / f["length"]
    if f["width"] > 0.0:
        turn = M[f["axis"]] / f["width"]
    return x + u, y + v, x - u, y - v, turn


@kernel
def _round_off_of_load(run, f):
    """The bearing load whose friction stretches the bristle by the round-off of its place, N."""
    iv = run.system.parts.coordinates[f["coordinate"]]["iv"]
    place = f["radius"] * run.state.first_places[0, iv] / run.system.weights[iv]
    return f["k"] * place / f["static"] if f["static"] > 0.0 else 0.0


@unit
def put_loads(run: Run, frictions: JointFrictions, at: Point) -> float:
    """Bearing loads of all joint frictions for these multipliers; returns the largest change."""
    rows, load, w = frictions.rows, frictions.scratch.load, run.work.dense.g[1]
    change = 0.0
    for k in range(rows.shape[0]):
        f = rows[k]
        put_group_wrench(run, f["group"], at.lam)
        parts = _bearing(run, f, w)
        a, b, c, d, turn = parts
        for i in range(_PARTS):
            frictions.scratch.bearing[k, i] = parts[i]
        N = math.sqrt(a * a + b * b) + math.sqrt(c * c + d * d) + abs(turn)
        least = _round_off_of_load(run, f)
        N = (N - least * least / N if N > least else 0.0) + f["preload"]
        step = abs(N - load[k, 0])
        if not step <= change:
            change = step
        load[k, 0] = N
    return change


@unit
def put_forces(run: Run, frictions: JointFrictions, at: Point) -> int:
    """res −= friction on its coordinate, for all joint frictions."""
    rows, coordinates, res = frictions.rows, run.system.parts.coordinates, run.work.trial.res
    for k in range(rows.shape[0]):
        evaluate_surface(run, frictions, at, k)
        force = frictions.scratch.surface[0]["force"]
        frictions.scratch.load[k, 1] = force
        res[coordinates[rows[k]["coordinate"]]["iv"]] -= rows[k]["radius"] * force
    return SUCCESS


@unit
def add_tangents(run: Run, frictions: JointFrictions, at: Point, cv: float, cp: float) -> int:
    """cv ∂F/∂v + cp ∂F/∂q on the diagonal of each coordinate.

    As all that acts on coordinates without mass, not at the acceleration level.
    """
    rows, coordinates, panels = frictions.rows, run.system.parts.coordinates, run.system.kkt.panels
    low, up, surface = run.work.factor.low, run.work.factor.up, frictions.scratch.surface[0]
    if cv != 0.0:
        for k in range(rows.shape[0]):
            f = rows[k]
            place = panels[coordinates[f["coordinate"]]["panel"]]["at"]
            evaluate_surface(run, frictions, at, k)
            diagonal = f["radius"] ** 2 * (cp * surface["stiffness"] + cv * surface["damping"])
            low[place] += diagonal
            up[place] += diagonal
    return SUCCESS


@unit
def put_couplings(run: Run, frictions: JointFrictions, at: Point, cv: float, cp: float) -> int:
    """−∂(friction on its coordinate)/∂λ of all joint frictions, in the unsymmetric matrix."""
    rows, surface = frictions.rows, frictions.scratch.surface[0]
    for k in range(rows.shape[0]):
        f = rows[k]
        evaluate_surface(run, frictions, at, k)
        if surface["load"] != 0.0:
            put_group_wrench(run, f["group"], at.lam)
            _put_coupling(run, f, f["radius"] * surface["load"])
    return SUCCESS


@kernel
def _put_coupling(run, f, factor):
    """factor ∂N/∂λ in the row of the coordinate, at the columns of the joint's rows.

    The wrench of the joint is in dense.g[1].
    """
    sys, g = run.system, run.work.row.g
    low, up = run.work.factor.low, run.work.factor.up
    group, link = sys.groups[f["group"]], sys.kkt.links[f["link"]]
    a, b, c, d, turn = _bearing(run, f, run.work.dense.g[1])
    first, second = math.sqrt(a * a + b * b), math.sqrt(c * c + d * d)
    for r in range(group["n"]):
        put_row_gradient(run, sys.rows[group["row"] + r])
        p, q, s, t, change = _bearing(run, f, g)  # of λ = −1
        slope = -change if turn > 0.0 else change if turn < 0.0 else 0.0
        if first > 0.0:
            slope -= (a * p + b * q) / first
        if second > 0.0:
            slope -= (c * s + d * t) / second
        if link["flipped"] == 1:
            low[link["at"] + r] = factor * slope
        else:
            up[link["at"] + r * link["stride"]] = factor * slope


@unit
def add_powers(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Power of all joint frictions, that into bristles included."""
    rows, coordinates, out = frictions.rows, run.system.parts.coordinates, run.work.powers
    for k in range(rows.shape[0]):
        f = rows[k]
        evaluate_surface(run, frictions, at, k)
        rate = f["radius"] * at.v[coordinates[f["coordinate"]]["iv"]]
        out[DAMPER_POWER] += frictions.scratch.surface[0]["force"] * rate
    return SUCCESS


@unit
def add_energies(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Energy in the bristles, ½ k s²."""
    rows, out = frictions.rows, run.work.energies
    for k in range(rows.shape[0]):
        bristle = evaluate_surface(run, frictions, at, k)
        out[BRISTLE_ENERGY] += 0.5 * rows[k]["k"] * bristle * bristle
    return SUCCESS


@unit
def free_bristles(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Free all bristles at the first position."""
    rows, coordinates, history = frictions.rows, run.system.parts.coordinates, run.state.history
    for k in range(rows.shape[0]):
        f = rows[k]
        o = f["history"]
        history[o + _ANCHOR] = f["radius"] * at.q[coordinates[f["coordinate"]]["iq"]]
        history[o + _MODE], history[o + _SPAN] = FREE, -1.0
    return SUCCESS


@kernel
def load_rate(past, o, span, parts):
    """Rate of a bearing load of these parts (5,), N/s.

    Its history `past` stands from o on, and is `span` old, s.
    """
    before = past[o + _SPAN]
    if not span > 0.0 or before < 0.0:
        return past[o + _RATE]
    rate = 0.0
    for first in range(0, _PARTS, 2):
        size, along, rates = 0.0, 0.0, 0.0
        for i in range(first, min(first + 2, _PARTS)):
            slope = (parts[i] - past[o + _LAST + i]) / span
            if before > 0.0:
                earlier = (past[o + _LAST + i] - past[o + _EARLIER + i]) / before
                slope += span / (span + before) * (slope - earlier)
            size += parts[i] * parts[i]
            along += parts[i] * slope
            rates += slope * slope
        rate += along / math.sqrt(size) if size > 0.0 else math.sqrt(rates)
    return rate


@kernel
def limit_growth(f, N, rate, v, change, side):
    """The speed at which the limit of a bristle to a side grows, m/s; change: that of v."""
    mu, slope = friction_coefficient(f, abs(v))
    more = change if v > 0.0 else -change if v < 0.0 else abs(change)
    released = f["c"] * max(-side * change, 0.0) if v == 0.0 else (
        -f["c"] * side * change if side * v < 0.0 else 0.0
    )  # fmt: skip
    return (mu * rate + slope * more * N + released) / f["k"]


@unit
def update_history(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Write the history of all joint frictions at an accepted state."""
    rows, surface, history, now = (
        frictions.rows, frictions.scratch.surface[0], run.state.history, run.work.now
    )  # fmt: skip
    coordinates = run.system.parts.coordinates
    for k in range(rows.shape[0]):
        f, N, iv = rows[k], frictions.scratch.load[k, 0], coordinates[rows[k]["coordinate"]]["iv"]
        s, o, mode = evaluate_surface(run, frictions, at, k), f["history"], FREE
        parts = frictions.scratch.bearing[k]
        rate, v = load_rate(now.history, o, now.span[0], parts), f["radius"] * at.v[iv]
        if f["model"] == BRISTLE and surface["room"] >= 0.0:
            side = math.copysign(1.0, s)
            growth = limit_growth(f, N, rate, v, f["radius"] * at.vd[iv], side)
            mode = side * FULL if side * v > growth else FREE
        bends = mode != now.history[o + _MODE] or now.history[o + _SPAN] < 0.0
        history[o + _ANCHOR], history[o + _MODE] = surface["position"] - s, mode
        history[o + _SPAN], history[o + _RATE] = 0.0 if bends else now.span[0], rate
        for i in range(_PARTS):
            history[o + _EARLIER + i] = now.history[o + _LAST + i]
            history[o + _LAST + i] = parts[i]
    return SUCCESS


@unit
def forget_rates(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Behind a jump of forces nothing is known of the rates of bearing loads."""
    rows, history = frictions.rows, run.state.history
    for k in range(rows.shape[0]):
        o = rows[k]["history"]
        history[o + _SPAN], history[o + _RATE] = 0.0, 0.0
        for i in range(_PARTS):
            history[o + _LAST + i] = frictions.scratch.bearing[k, i]
    return SUCCESS


@unit
def put_events(run: Run, frictions: JointFrictions, at: Point) -> int:
    """What crosses zero where it slips or sticks, and where its full bristle becomes free.

    With rates, but for those of rates of the bearing load. What slides while its bristle becomes
    full feels nothing of it. Smooth friction has no such moment; that its speed falls below that of
    creeping and rises again within a step is watched all the same.
    """
    rows, surface, now = frictions.rows, frictions.scratch.surface[0], run.work.now
    coordinates, out = run.system.parts.coordinates, run.work.events.now
    for k in range(rows.shape[0]):
        f, o = rows[k], frictions.first_event + 2 * k
        slip, length, N = out[o], out[o + 1], frictions.scratch.load[k, 0]
        iv = coordinates[f["coordinate"]]["iv"]
        v, change = f["radius"] * at.v[iv], f["radius"] * at.vd[iv]
        length["value"], length["rate"] = 0.0, math.nan
        if f["model"] != BRISTLE:
            slip["value"] = min(f["creep"] - abs(v), -_EVENT_CLEARANCE * f["creep"])
            slip["rate"] = -change if v > 0.0 else change
            if abs(v) < f["creep"]:  # there its law is smooth
                slip["rate"] = math.nan
            continue
        if N == 0.0:
            slip["value"], slip["rate"] = 0.0, math.nan
            continue
        h = f["history"]
        evaluate_surface(run, frictions, at, k)
        mode = now.history[h + _MODE]
        rate = load_rate(now.history, h, now.span[0], frictions.scratch.bearing[k])
        side = math.copysign(1.0, mode if abs(mode) == FULL else -surface["force"])
        growth = limit_growth(f, N, rate, v, change, side)
        if abs(mode) == FULL:
            slip["value"], slip["rate"] = 0.0, math.nan
            length["value"], length["rate"] = growth - side * v, -side * change
        else:
            slip["value"] = surface["excess"] - LEAST_EXCESS * N
            damped = f["c"] * side * change  # what is let go has it in its growth
            slip["rate"] = f["k"] * (side * v - growth)
            slip["rate"] += damped if side * v > 0.0 else max(damped, 0.0) if v == 0.0 else 0.0
    return SUCCESS


JOINT_FRICTIONS = Kind(
    "joint_frictions",
    JointFrictions,
    {
        "reaction": put_loads,
        "force": put_forces,
        "matrix": add_tangents,
        "coupling": put_couplings,
        "power": add_powers,
        "energy": add_energies,
        "begin": free_bristles,
        "update_history": update_history,
        "jump": forget_rates,
        "events": put_events,
    },
    lower=lower_joint_frictions,
    types=("joint-friction",),
    place=place_joint_frictions,
    unsymmetric=lambda frictions: True,
    scratch=lambda frictions: Scratch(
        np.full((len(frictions.rows), 2), np.nan),
        np.zeros((len(frictions.rows), _PARTS)),
        np.zeros(1, SURFACE),
    ),
)
