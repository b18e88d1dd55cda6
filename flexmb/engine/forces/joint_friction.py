"""Friction in joints, acting on a massless scalar coordinate that equals the joint's displacement.

The normal force N (bearing load) follows from the joint's reaction on J in the axes of I. A bearing
of length L carries the lateral force F and the bending moment M by two forces at its ends,
R₁,₂ = F/2 ± (M × z)/L, so N = |R₁| + |R₂|. In a guide of width w a torque T about its axis adds
|T|/w, a preload its function of time. A reaction at round-off does not count: its friction would
stretch the bristle by the round-off of its position. So unloaded joints have no friction.

N is evaluated with the multipliers of the present iterate. Its derivatives with respect to them are
in the unsymmetric iteration matrix; at the acceleration level a fixed-point iteration is used
instead. If friction grows as fast as the forces that cause it, neither converges: the joint is
self-locking. The growth of the limit μ N/k of a bristle follows from R₁, R₂ and T/w of the last
three accepted states, by the end slopes of the parabolas through them, or of straight lines after a
discontinuity of slope; that of a preload is the derivative of its function.

Source of the bearing's forces: Haug, Wu & Yang, Mech. Mach. Theory 21 (1986) 401.
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
# Friction in a joint, on a scalar coordinate s equal to the joint's displacement (m or rad). The
# surface moves by radius times s. Internal variables: see `_ANCHOR` and the following indices.
JOINT_FRICTION = np.dtype(
    [
        ("group", _I),  # of the joint
        ("coordinate", _I),
        ("link", _I),  # LINK of the joint's rows with the coordinate
        ("axis", _I),  # axis of marker I along which the joint slides or about which it turns
        ("radius", _F),  # of the pin, m; 1 for a translation
        ("length", _F),  # of the bearing, m; 0: bending moments cause no bearing load
        ("width", _F),  # of the guide, m; 0: a torque about the axis causes no bearing load
        ("preload", _F),  # N, without its function
        ("fun", _I),  # function of time of a preload; -1: it is constant
        *FRICTION_FIELDS,
    ],
    align=True,
)


# State of the friction of one joint, on the surface of its pin or guide: force (N), bristle s (m),
# excess |T| − μ N, overload k |s| − μ N for s without its limit, derivatives of −force with
# respect to position (stiffness), velocity (damping) and bearing load (load), position (m).
_WORDS = ("force", "bristle", "excess", "overload", "stiffness", "damping", "load", "position")
SURFACE = np.dtype([(word, _F) for word in _WORDS], align=True)


class Scratch(NamedTuple):
    """Scratch of all joint frictions."""

    load: Matrix  # (n, 2) bearing load from the multipliers, and force of friction, N
    bearing: Matrix  # (n, 5) the components of this load: R₁ and R₂ (2 each) and T/w, N
    surface: array_of(SURFACE)  # (1,) the friction that was evaluated last


class JointFrictions(NamedTuple):
    """Frictions in joints of a model."""

    rows: array_of(JOINT_FRICTION)
    first_event: int  # two event functions each: sliding or sticking, bristle becomes free
    scratch: Scratch = None  # of one run


# Indices of the internal variables of one friction. _ANCHOR: position at which its bristle has zero
# length, m; _MODE: FREE or ±FULL with the sign of the bristle; _RATE: rate of the bearing load,
# N/s; _SPAN: time between the last accepted state and the one before, s (0: the one before is not
# used; < 0: the last state is the first of the run); _LAST, _EARLIER: R₁, R₂ and T/w at these two.
_ANCHOR, _MODE, _RATE, _SPAN, _LAST, _EARLIER, _HISTORY = 0, 1, 2, 3, 4, 9, 14
_N_COMPONENTS = 5


def lower_joint_frictions(lowering: Lowering, forces: Forces) -> JointFrictions:
    """JOINT_FRICTION rows of all frictions in joints; `link` is filled in later."""
    groups = lowering.groups
    rows: list[tuple[object, ...]] = []
    for name, spec in forces:
        group, k = groups.numbers[f"joints.{spec.joint}"], lowering.coordinate(f"forces.{name}")
        stroke, constant = not lowering.scalars[k].angular, spec.preload.constant
        rows.append(
            (
                group, k, -1, 0 if stroke and lowering.model.plane is not None else 2,
                1.0 if stroke else spec.radius, spec.length or 0.0, spec.width or 0.0,
                constant or 0.0,
                -1 if constant is not None else lowering.functions.add(spec.preload.expression),
                *friction_parameters(spec),
                lowering.add_history(_HISTORY),
            )
        )  # fmt: skip
        lowering.reaction_loads.append((group, k))
        lowering.markers.framed.add(groups.in_group(group)[0].I)  # the reaction is read in its axes
    return JointFrictions(np.array(rows, JOINT_FRICTION), lowering.add_events(2 * len(rows)))


def place_joint_frictions(frictions: JointFrictions, placement: Placement) -> None:
    """Fill in `link`: the block of the matrix for each coordinate and the rows of its joint."""
    links, first = placement.symbolic.coordinate_links, placement.n_bodies
    for row in frictions.rows:
        row["link"] = links[int(row["group"]), first + int(row["coordinate"])]


# The event function of smooth friction stays below zero by this fraction of its creep speed.
_EVENT_CLEARANCE = 1e-3


@unit
def evaluate_surface(run: Run, frictions: JointFrictions, at: Point, k: int) -> float:
    """Evaluate friction k at position and velocity of its coordinate, into `scratch.surface`.

    Returns the bristle, m.
    """
    f, out, history = frictions.rows[k], frictions.scratch.surface[0], run.work.now.history
    s, o = run.system.parts.coordinates[f["coordinate"]], f["history"]
    x, rate = f["radius"] * at.q[s["iq"]], f["radius"] * at.v[s["iv"]]
    force, bristle, excess, overload, stiffness, damping, load = line_friction(
        f, frictions.scratch.load[k, 0], x - history[o + _ANCHOR], rate, history[o + _MODE]
    )
    out["force"], out["bristle"], out["excess"], out["overload"] = (
        force, bristle, excess, overload
    )  # fmt: skip
    out["stiffness"], out["damping"], out["load"], out["position"] = stiffness, damping, load, x
    return bristle


@kernel
def _bearing(run, f, w):
    """Forces R₁ and R₂ normal to the axis (2 each), and T/w, from the wrench pair w (12)."""
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
    """Bearing load, N, whose friction stretches the bristle by the round-off of its position."""
    iv = run.system.parts.coordinates[f["coordinate"]]["iv"]
    place = f["radius"] * run.state.first_round_off[0, iv] / run.system.weights[iv]
    return f["k"] * place / f["static"] if f["static"] > 0.0 else 0.0


@kernel
def _preload(run, f):
    return max(run.work.con.fun[f["fun"], 0], 0.0) if f["fun"] >= 0 else f["preload"]


@kernel
def _preload_rate(run, f):
    return run.work.con.fun[f["fun"], 1] if f["fun"] >= 0 else 0.0


@unit
def put_loads(run: Run, frictions: JointFrictions, at: Point) -> float:
    """Put the bearing loads of all joint frictions for `at.lam`; return the largest change, N."""
    rows, load, w = frictions.rows, frictions.scratch.load, run.work.dense.g[1]
    change = 0.0
    for k in range(rows.shape[0]):
        f = rows[k]
        put_group_wrench(run, f["group"], at.lam)
        parts = _bearing(run, f, w)
        a, b, c, d, turn = parts
        for i in range(_N_COMPONENTS):
            frictions.scratch.bearing[k, i] = parts[i]
        N = math.sqrt(a * a + b * b) + math.sqrt(c * c + d * d) + abs(turn)
        least = _round_off_of_load(run, f)
        N = (N - least * least / N if N > least else 0.0) + _preload(run, f)
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
    """Add cv ∂F/∂v + cp ∂F/∂q, F the resistance of friction, to the diagonal of each coordinate.

    At the acceleration level, cv = 0, nothing is added, as these coordinates have no mass.
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
    """Put −∂(friction on its coordinate)/∂λ of all joint frictions into the unsymmetric matrix."""
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
    """Put factor ∂N/∂λ into the row of the coordinate, at the columns of the joint's rows.

    dense.g[1] holds the wrench pair of the joint.
    """
    sys, g = run.system, run.work.row.g
    low, up = run.work.factor.low, run.work.factor.up
    group, link = sys.groups[f["group"]], sys.kkt.links[f["link"]]
    a, b, c, d, turn = _bearing(run, f, run.work.dense.g[1])
    first, second = math.sqrt(a * a + b * b), math.sqrt(c * c + d * d)
    for r in range(group["n"]):
        put_row_gradient(run, sys.rows[group["row"] + r])
        p, q, s, t, change = _bearing(run, f, g)  # for a multiplier λ = −1 of row r
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
    """Power of all joint frictions, including the power that bristles store."""
    rows, coordinates, out = frictions.rows, run.system.parts.coordinates, run.work.powers
    for k in range(rows.shape[0]):
        f = rows[k]
        evaluate_surface(run, frictions, at, k)
        rate = f["radius"] * at.v[coordinates[f["coordinate"]]["iv"]]
        out[DAMPER_POWER] += frictions.scratch.surface[0]["force"] * rate
    return SUCCESS


@unit
def add_energies(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Elastic energy of the bristles, Σ ½ k s²."""
    rows, out = frictions.rows, run.work.energies
    for k in range(rows.shape[0]):
        bristle = evaluate_surface(run, frictions, at, k)
        out[BRISTLE_ENERGY] += 0.5 * rows[k]["k"] * bristle * bristle
    return SUCCESS


@unit
def free_bristles(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Begin a run: all bristles are free and have zero length at the initial position."""
    rows, coordinates, history = frictions.rows, run.system.parts.coordinates, run.state.history
    for k in range(rows.shape[0]):
        f = rows[k]
        o = f["history"]
        history[o + _ANCHOR] = f["radius"] * at.q[coordinates[f["coordinate"]]["iq"]]
        history[o + _MODE], history[o + _SPAN] = FREE, -1.0
    return SUCCESS


@kernel
def load_rate(past, o, span, parts):
    """Rate of the bearing load with the components `parts` (5,), N/s.

    past[o:] are its internal variables at the last accepted state, `span` seconds ago.
    """
    before = past[o + _SPAN]
    if not span > 0.0 or before < 0.0:
        return past[o + _RATE]
    rate = 0.0
    for first in range(0, _N_COMPONENTS, 2):
        size, along, rates = 0.0, 0.0, 0.0
        for i in range(first, min(first + 2, _N_COMPONENTS)):
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
    """Growth rate of the limit of a bristle of sign `side`, m/s; rate: of N; change: of v."""
    mu, slope = friction_coefficient(f, abs(v))
    more = change if v > 0.0 else -change if v < 0.0 else abs(change)
    released = f["c"] * max(-side * change, 0.0) if v == 0.0 else (
        -f["c"] * side * change if side * v < 0.0 else 0.0
    )  # fmt: skip
    return (mu * rate + slope * more * N + released) / f["k"]


@unit
def update_history(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Write the internal variables of all joint frictions at an accepted state."""
    rows, surface, history, now = (
        frictions.rows, frictions.scratch.surface[0], run.state.history, run.work.now
    )  # fmt: skip
    coordinates = run.system.parts.coordinates
    for k in range(rows.shape[0]):
        f, N, iv = rows[k], frictions.scratch.load[k, 0], coordinates[rows[k]["coordinate"]]["iv"]
        s, o, mode = evaluate_surface(run, frictions, at, k), f["history"], FREE
        parts = frictions.scratch.bearing[k]
        rate, v = load_rate(now.history, o, now.span[0], parts), f["radius"] * at.v[iv]
        if f["model"] == BRISTLE and surface["overload"] >= 0.0:
            side = math.copysign(1.0, s)
            change, pressing = f["radius"] * at.vd[iv], _preload_rate(run, f)
            growth = limit_growth(f, N, rate + pressing, v, change, side)
            mode = side * FULL if side * v > growth else FREE
        bends = mode != now.history[o + _MODE] or now.history[o + _SPAN] < 0.0
        history[o + _ANCHOR], history[o + _MODE] = surface["position"] - s, mode
        history[o + _SPAN], history[o + _RATE] = 0.0 if bends else now.span[0], rate
        for i in range(_N_COMPONENTS):
            history[o + _EARLIER + i] = now.history[o + _LAST + i]
            history[o + _LAST + i] = parts[i]
    return SUCCESS


@unit
def forget_rates(run: Run, frictions: JointFrictions, at: Point) -> int:
    """After a jump of the forces restart the rates of bearing loads from the present ones."""
    rows, history = frictions.rows, run.state.history
    for k in range(rows.shape[0]):
        o = rows[k]["history"]
        history[o + _SPAN], history[o + _RATE] = 0.0, 0.0
        for i in range(_N_COMPONENTS):
            history[o + _LAST + i] = frictions.scratch.bearing[k, i]
    return SUCCESS


@unit
def put_events(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Event functions: zero where sliding begins or ends, and where a full bristle becomes free.

    Their rates neglect the second time derivative of the bearing load. A bristle that becomes full
    while it slides causes no event, since its force does not change there. Smooth friction has no
    event; its function is there so that a step sees the speed fall below the creep speed and rise
    again.
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
            if abs(v) < f["creep"]:  # the force is a smooth function of v there
                slip["rate"] = math.nan
            continue
        if N == 0.0:
            slip["value"], slip["rate"] = 0.0, math.nan
            continue
        h = f["history"]
        evaluate_surface(run, frictions, at, k)
        mode = now.history[h + _MODE]
        rate = load_rate(now.history, h, now.span[0], frictions.scratch.bearing[k])
        rate += _preload_rate(run, f)
        side = math.copysign(1.0, mode if abs(mode) == FULL else -surface["force"])
        growth = limit_growth(f, N, rate, v, change, side)
        if abs(mode) == FULL:
            slip["value"], slip["rate"] = 0.0, math.nan
            length["value"], length["rate"] = growth - side * v, -side * change
        else:
            slip["value"] = surface["excess"] - LEAST_EXCESS * N
            damped = f["c"] * side * change  # while v releases the bristle, growth contains it
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
        np.zeros((len(frictions.rows), _N_COMPONENTS)),
        np.zeros(1, SURFACE),
    ),
)
