"""Friction in joints, on a scalar coordinate without mass that follows the joint's.

The normal force N comes from the joint's reaction on J in the axes of I. A bearing of length L
carries the lateral force F and the bending moment M as two forces at its ends,
R₁,₂ = F/2 ± (M × z)/L, so N = |R₁| + |R₂|; a guide of width w carries a torque T about its axis
with |T|/w more; a preload adds to it. N belongs to the multipliers of the iterate; its slope over
them stands in the unsymmetric iteration matrix, while reported accelerations are iterated for.
Where friction grows as fast as the forces that cause it, neither settles: the joint locks itself.
Source of the bearing's share: Haug, Wu & Yang, Mech. Mach. Theory 21 (1986) 401.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import turned_back
from flexmb.engine.forces.friction import (
    BRISTLE,
    FRICTION_FIELDS,
    LEAST_EXCESS,
    SLIDES,
    YIELDS,
    friction_parameters,
    line_friction,
    next_mode,
)
from flexmb.engine.jit import Matrix, array_of, kernel, unit
from flexmb.engine.joints.constraint import put_group_wrench
from flexmb.engine.joints.row import put_row_gradient
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.state import BRISTLE_ENERGY, DAMPER_POWER, Point, Run

if TYPE_CHECKING:
    from flexmb.engine.lowering import Forces, Lowering, Placement

_I, _F = "i8", "f8"
# Friction in a joint, on a scalar coordinate s that follows the joint's; the surface moves by
# radius times s. It remembers the anchor of the bristle (m), and whether it slides.
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


# Friction of one joint now, on the surface of its pin or guide: force (N), anchor of the bristle
# (m), mode (STICKS, SLIDES, −SLIDES), |T| − μ N, slopes of −force over position and speed, position
# (m).
_WORDS = ("force", "anchor", "mode", "excess", "stiffness", "damping", "position")
SURFACE = np.dtype([(word, _F) for word in _WORDS], align=True)


class Scratch(NamedTuple):
    load: Matrix  # (n, 2) bearing load, from the multipliers, and force of friction, N
    surface: array_of(SURFACE)  # (1,) the friction that was evaluated last


class JointFrictions(NamedTuple):
    """Frictions in joints of a model."""

    rows: array_of(JOINT_FRICTION)
    first_event: int  # each has one: what makes it slide or stick
    scratch: Scratch = None  # of one run


_ANCHOR_PLACE, _MODE_PLACE, _HISTORY = 0, 1, 2  # places of history of one friction, and how many


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
    return JointFrictions(np.array(rows, JOINT_FRICTION), lowering.add_events(len(rows)))


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

    Returns the stretch of its bristle, m.
    """
    f, out, history = frictions.rows[k], frictions.scratch.surface[0], run.work.now.history
    s = run.system.parts.coordinates[f["coordinate"]]
    x, rate = f["radius"] * at.q[s["iq"]], f["radius"] * at.v[s["iv"]]
    force, anchor, mode, excess, stiffness, damping = line_friction(
        f, frictions.scratch.load[k, 0], x, rate, history[f["history"] + _ANCHOR_PLACE]
    )
    out["force"], out["anchor"], out["mode"], out["excess"] = force, anchor, mode, excess
    out["stiffness"], out["damping"], out["position"] = stiffness, damping, x
    return x - anchor


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


@unit
def put_loads(run: Run, frictions: JointFrictions, at: Point) -> float:
    """Bearing loads of all joint frictions for these multipliers; returns the largest change."""
    rows, load, w = frictions.rows, frictions.scratch.load, run.work.dense.g[1]
    change = 0.0
    for k in range(rows.shape[0]):
        f = rows[k]
        put_group_wrench(run, f["group"], at.lam)
        a, b, c, d, turn = _bearing(run, f, w)
        N = math.sqrt(a * a + b * b) + math.sqrt(c * c + d * d) + abs(turn) + f["preload"]
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
    return FINE


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
    return FINE


@unit
def put_couplings(run: Run, frictions: JointFrictions, at: Point, cv: float, cp: float) -> int:
    """−∂(friction on its coordinate)/∂λ of all joint frictions, in the unsymmetric matrix."""
    rows, surface = frictions.rows, frictions.scratch.surface[0]
    for k in range(rows.shape[0]):
        f, N = rows[k], frictions.scratch.load[k, 0]
        evaluate_surface(run, frictions, at, k)
        if abs(surface["mode"]) == SLIDES and N > 0.0:  # then the force is in proportion to N
            put_group_wrench(run, f["group"], at.lam)
            _put_coupling(run, f, -f["radius"] * surface["force"] / N)
    return FINE


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
    return FINE


@unit
def add_energies(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Energy in the bristles, ½ k s²."""
    rows, out = frictions.rows, run.work.energies
    for k in range(rows.shape[0]):
        stretch = evaluate_surface(run, frictions, at, k)
        out[BRISTLE_ENERGY] += 0.5 * rows[k]["k"] * stretch * stretch
    return FINE


@unit
def free_bristles(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Free all bristles at the first position."""
    rows, coordinates, history = frictions.rows, run.system.parts.coordinates, run.state.history
    for k in range(rows.shape[0]):
        f = rows[k]
        o = f["history"]
        history[o + _ANCHOR_PLACE] = f["radius"] * at.q[coordinates[f["coordinate"]]["iq"]]
        history[o + _MODE_PLACE] = 0.0
    return FINE


@unit
def remember(run: Run, frictions: JointFrictions, at: Point) -> int:
    """Write the history of all joint frictions at an accepted state."""
    rows, surface, history = frictions.rows, frictions.scratch.surface[0], run.state.history
    coordinates = run.system.parts.coordinates
    for k in range(rows.shape[0]):
        evaluate_surface(run, frictions, at, k)
        o, mode, iv = rows[k]["history"], surface["mode"], coordinates[rows[k]["coordinate"]]["iv"]
        history[o + _ANCHOR_PLACE] = surface["anchor"]
        history[o + _MODE_PLACE] = next_mode(history[o + _MODE_PLACE], mode, mode * at.v[iv])
    return FINE


@unit
def put_events(run: Run, frictions: JointFrictions, at: Point) -> int:
    """What crosses zero from below where it begins to slide, or to stick, as of contacts.

    With its rate, but for that of the bearing load. Smooth friction has no such moment; that its
    speed falls below that of creeping and rises again within a step is watched all the same.
    """
    rows, surface, history = frictions.rows, frictions.scratch.surface[0], run.work.now.history
    coordinates, out = run.system.parts.coordinates, run.work.events.now
    for k in range(rows.shape[0]):
        f, slip = rows[k], out[frictions.first_event + k]
        iv = coordinates[f["coordinate"]]["iv"]
        speed, change = f["radius"] * at.v[iv], f["radius"] * at.vd[iv]
        if f["model"] != BRISTLE:
            slip["value"] = min(f["creep"] - abs(speed), -_EVENT_CLEARANCE * f["creep"])
            slip["rate"] = -change if speed > 0.0 else change
            if abs(speed) < f["creep"]:  # there its law is smooth
                slip["rate"] = math.nan
            continue
        evaluate_surface(run, frictions, at, k)
        stretch = surface["position"] - history[f["history"] + _ANCHOR_PLACE]
        mode = history[f["history"] + _MODE_PLACE]
        if abs(mode) == SLIDES:
            sign = math.copysign(1.0, mode)
            slip["value"], slip["rate"] = -sign * speed, -sign * change
        elif mode == YIELDS:
            slip["value"], slip["rate"] = 0.0, math.nan
        else:
            sign = 1.0 if f["k"] * stretch + f["c"] * speed > 0.0 else -1.0
            slip["value"] = surface["excess"] - LEAST_EXCESS * frictions.scratch.load[k, 0]
            slip["rate"] = sign * (f["k"] * speed + f["c"] * change)
    return FINE


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
        "remember": remember,
        "events": put_events,
    },
    lower=lower_joint_frictions,
    types=("joint-friction",),
    place=place_joint_frictions,
    unsymmetric=lambda frictions: True,
    scratch=lambda frictions: Scratch(
        np.full((len(frictions.rows), 2), np.nan), np.zeros(1, SURFACE)
    ),
)
