"""Markers: position, velocity and acceleration bias.

Rigid: p = r + A ρ. Flexible: p = r + A s, s = ρ + Φ_t η + E ŝ with E = exp(θ̃), θ = Φ_r η and an
arm ŝ that turns with its node; orientation A E R. With T = T(θ) the angular velocity in body axes
is ω' + Tᵀ Φ_r η̇ and a wrench (f, τ) acts on (r, orientation, η) as
(f, s × f' + τ', Φ_tᵀ f' + Φ_rᵀ T (τ' + E ŝ × f')), primes in body axes.

If the geometric stiffness of the body is known, s is reduced by ½ ηᵀ K_d η along the axis d, and
Φ_t by ηᵀ K_d, with K_d that of a unit force at the marker; θ and Φ_r likewise by those of unit
moments, where these matter. The same numbers give foreshortening and
stiffening, so that energy is conserved (Wallrapp & Schwertassek, IJNME 32 (1991) 1833).

Point markers are those of which only the position is needed: all their rows are point constraints.
Such rows have no moment and need no axes. So the position stage does not compute axes, nor the
velocity stage angular velocities; the stage `axes` adds them for outputs and for Python. The forces
on point markers are those of `joints.point_joint`.
Names: mk, mn one row of the marker tables (constant, now); body, bn likewise of a body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.algebra.forms import (
    bend_with_axis,
    bending_acceleration,
    put_bent_modes,
    rows_of_bend,
)
from flexmb.engine.algebra.vector import (
    axis_vector,
    column,
    cross,
    inner,
    modal_vector,
    part,
    plus,
    put_column,
    put_part,
    tangent_coefficients,
    times,
    triple,
    turned,
    turned_back,
    turned_by,
)
from flexmb.engine.bodies.wrench import apply_wrench
from flexmb.engine.jit import Integers, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Point, Run
from flexmb.engine.tables import MARKER, Pool

if TYPE_CHECKING:
    from flexmb.model.markers import PlacedMarker


class Markers(NamedTuple):
    """Markers of one kind."""

    rows: Integers  # their rows in the table of markers


@unit
def place_rigid(run: Run, markers: Markers, at: Point) -> int:
    """Position and orientation of the markers on rigid bodies and on ground."""
    parts, now, q = run.system.parts, run.work.now, at.q
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    body_now, marker_now = now.body, now.marker
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], marker_now[rows[n]]
        b = mk["body"]
        if b < 0:
            _ground_position(mk, mn)
        else:
            _rigid_position(mk, mn, body_now[b]["A"], q, bodies[b]["iq"])
    return SUCCESS


@unit
def place_flexible(run: Run, markers: Markers, at: Point) -> int:
    """Position and orientation of the markers that modes move."""
    parts, now, q = run.system.parts, run.work.now, at.q
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        body, A, at_t, c = bodies[mk["body"]], now.body[mk["body"]]["A"], mk["modes"], mn["c"]
        m, iq = body["m"], body["iq"]
        th = modal_vector(parts.pool, at_t + 3 * m, m, q, iq + 7)
        moved = modal_vector(parts.pool, at_t, m, q, iq + 7)
        if mk["bend"] >= 0:
            phi = now.Phi[rows[n]]
            put_bent_modes(mk, parts.pool, q, iq + 7, m, phi)
            moved = times(0.5, plus(moved, 1.0, modal_vector(phi, 0, m, q, iq + 7)))
            if mk["forms"] > 3:
                th = times(0.5, plus(th, 1.0, modal_vector(phi, 3 * m, m, q, iq + 7)))
        square = inner(th, th)
        c[0], c[1], c[2], c[3] = tangent_coefficients(square)
        sine = 1.0 - c[1] * square  # sin θ/θ
        arm = turned_by(th, sine, c[0], triple(mk["arm"]))
        s = plus(plus(triple(mk["rho"]), 1.0, moved), 1.0, arm)
        put_part(mn["th"], 0, th)
        put_part(mn["arm"], 0, arm)
        put_part(mn["s"], 0, s)
        put_part(mn["x"], 0, plus(part(q, iq), 1.0, turned(A, s)))
        for k in range(3):
            put_column(mn["T"], k, turned_by(th, -c[0], c[1], axis_vector(k)))
            put_column(mn["R"], k, turned(A, turned_by(th, sine, c[0], column(mk["R"], k))))
    return SUCCESS


@kernel
def _ground_position(mk, mn):
    for a in range(3):
        mn["x"][a] = mk["rho"][a]
        for c in range(3):
            mn["R"][a, c] = mk["R"][a, c]


@kernel
def _rigid_position(mk, mn, A, q, iq):
    R, rho, s, x, axes = mk["R"], mk["rho"], mn["s"], mn["x"], mn["R"]
    for a in range(3):
        s[a] = rho[a]
        x[a] = q[iq + a] + A[a, 0] * rho[0] + A[a, 1] * rho[1] + A[a, 2] * rho[2]
        for c in range(3):
            axes[a, c] = A[a, 0] * R[0, c] + A[a, 1] * R[1, c] + A[a, 2] * R[2, c]


@unit
def move_rigid(run: Run, markers: Markers, at: Point) -> int:
    """Velocity and angular velocity of the markers on rigid bodies, global axes."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    body_now, marker_now = now.body, now.marker
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], marker_now[rows[n]]
        b = mk["body"]
        if b < 0:
            put_part(mn["vx"], 0, (0.0, 0.0, 0.0))
            put_part(mn["om"], 0, (0.0, 0.0, 0.0))
            continue
        A, iv = body_now[b]["A"], bodies[b]["iv"]
        om = part(v, iv + 3)
        moved = turned(A, cross(om, triple(mn["s"])))
        put_part(mn["vx"], 0, plus(part(v, iv), 1.0, moved))
        put_part(mn["om"], 0, turned(A, om))
    return SUCCESS


@unit
def move_flexible(run: Run, markers: Markers, at: Point) -> int:
    """Velocity and angular velocity of the markers that modes move, global axes."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        body, A = bodies[mk["body"]], now.body[mk["body"]]["A"]
        iv, om = body["iv"], part(v, body["iv"] + 3)
        phi = now.Phi[rows[n]] if mk["bend"] >= 0 else parts.pool
        u, e = _relative_velocity(mk, mn, body, phi, v)
        x = plus(cross(om, triple(mn["s"])), 1.0, u)
        put_part(mn["vx"], 0, plus(part(v, iv), 1.0, turned(A, x)))
        put_part(mn["om"], 0, turned(A, plus(om, 1.0, e)))
    return SUCCESS


@kernel
def _relative_velocity(mk, mn, body, phi, v):
    """Velocity and angular velocity Tᵀ θ̇ of a marker in its body, body axes."""
    m, o, place = body["m"], body["iv"] + 6, 0 if mk["bend"] >= 0 else mk["modes"]
    e = turned_back(mn["T"], modal_vector(phi, place + 3 * m, m, v, o))
    moved = modal_vector(phi, place, m, v, o)
    return plus(moved, 1.0, cross(e, triple(mn["arm"]))), e


@unit
def bias_flexible(run: Run, markers: Markers, at: Point) -> int:
    """Acceleration of the markers that modes move at zero v̇, global axes: point, angular."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        body, A, c = bodies[mk["body"]], now.body[mk["body"]]["A"], mn["c"]
        m, o, arm, th = body["m"], body["iv"] + 6, triple(mn["arm"]), triple(mn["th"])
        phi = now.Phi[rows[n]] if mk["bend"] >= 0 else parts.pool
        place = 0 if mk["bend"] >= 0 else mk["modes"]
        om, rate = part(v, o - 3), modal_vector(phi, place + 3 * m, m, v, o)
        u, e = _relative_velocity(mk, mn, body, phi, v)
        y, slope = cross(th, rate), 2.0 * inner(th, rate)
        change = plus(times(slope * c[2], y), c[1], cross(rate, y))
        change = plus(change, slope * c[3], cross(th, y))  # Ṫᵀ θ̇
        point = (0.0, 0.0, 0.0)
        if mk["bend"] >= 0:
            point, turning = bending_acceleration(mk, parts.pool, v, o, m, phi)
            change = plus(change, 1.0, turned_back(mn["T"], turning))
        # ω×(ω×s + 2u) + e×(e×arm) + Ṫᵀθ̇×arm
        x = cross(om, plus(cross(om, triple(mn["s"])), 2.0, u))
        x = plus(plus(x, 1.0, cross(e, cross(e, arm))), 1.0, plus(cross(change, arm), 1.0, point))
        put_part(mn["bx"], 0, turned(A, x))
        put_part(mn["bom"], 0, turned(A, plus(change, 1.0, cross(om, e))))
    return SUCCESS


@unit
def bias_rigid(run: Run, markers: Markers, at: Point) -> int:
    """Acceleration of the markers on rigid bodies at zero v̇, global axes: point, angular."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        put_part(mn["bx"], 0, (0.0, 0.0, 0.0))
        put_part(mn["bom"], 0, (0.0, 0.0, 0.0))
        b = mk["body"]
        if b >= 0:
            om = part(v, bodies[b]["iv"] + 3)
            x = cross(om, cross(om, triple(mn["s"])))
            put_part(mn["bx"], 0, turned(now.body[b]["A"], x))
    return SUCCESS


@unit
def clear_wrenches(run: Run, markers: Markers, at: Point) -> int:
    """Set the wrenches of all markers to zero."""
    rows, marker_now = markers.rows, run.work.now.marker
    for n in range(rows.shape[0]):
        W = marker_now[rows[n]]["W"]
        for c in range(6):
            W[c] = 0.0
    return SUCCESS


@unit
def subtract_wrenches(run: Run, markers: Markers, at: Point) -> int:
    """Trial.res −= generalised forces of the wrenches of all markers."""
    parts, now, out = run.system.parts, run.work.now, run.work.trial.res
    rows, table, bodies, marker_now = markers.rows, parts.markers, parts.bodies, now.marker
    for n in range(rows.shape[0]):
        b = table[rows[n]]["body"]
        if b >= 0:
            o = bodies[b]["iv"]
            apply_wrench(parts, now, rows[n], marker_now[rows[n]]["W"], 0, -1.0, out, o)
    return SUCCESS


RIGID_MARKERS = Kind(
    "rigid_markers",
    Markers,
    {
        "position": place_rigid,
        "velocity": move_rigid,
        "bias": bias_rigid,
        "wrench": clear_wrenches,
        "force": subtract_wrenches,
    },
)
FLEXIBLE_MARKERS = Kind(
    "flexible_markers",
    Markers,
    {
        "position": place_flexible,
        "velocity": move_flexible,
        "bias": bias_flexible,
        "wrench": clear_wrenches,
        "force": subtract_wrenches,
    },
)


@kernel
def _prepare(table, marker_now, rows):
    """Constants of a run: arms of markers in their bodies; positions of markers on ground."""
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], marker_now[rows[n]]
        for a in range(3):
            mn["s"][a] = mk["rho"][a]
            if mk["body"] < 0:
                mn["x"][a] = mk["rho"][a]
                mn["vx"][a] = 0.0


@unit
def prepare_points(run: Run, markers: Markers, at: Point) -> int:
    """Set the constants of a run."""
    _prepare(run.system.parts.markers, run.work.now.marker, markers.rows)
    return SUCCESS


@unit
def place_points(run: Run, markers: Markers, at: Point) -> int:
    """Position of the markers."""
    parts, now, q = run.system.parts, run.work.now, at.q
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    body_now, marker_now = now.body, now.marker
    for n in range(rows.shape[0]):
        mk = table[rows[n]]
        b = mk["body"]
        if b >= 0:
            A, s, x, iq = body_now[b]["A"], mk["rho"], marker_now[rows[n]]["x"], bodies[b]["iq"]
            for a in range(3):
                x[a] = q[iq + a] + A[a, 0] * s[0] + A[a, 1] * s[1] + A[a, 2] * s[2]
    return SUCCESS


@unit
def move_points(run: Run, markers: Markers, at: Point) -> int:
    """Velocity of the markers, global axes."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    body_now, marker_now = now.body, now.marker
    for n in range(rows.shape[0]):
        mk = table[rows[n]]
        b = mk["body"]
        if b >= 0:
            iv = bodies[b]["iv"]
            moved = turned(body_now[b]["A"], cross(part(v, iv + 3), triple(mk["rho"])))
            put_part(marker_now[rows[n]]["vx"], 0, plus(part(v, iv), 1.0, moved))
    return SUCCESS


@unit
def complete_points(run: Run, markers: Markers, at: Point) -> int:
    """Add axes and angular velocities of the markers, as those of rigid markers."""
    place_rigid(run, markers, at)
    return move_rigid(run, markers, at)


POINT_MARKERS = Kind(
    "point_markers",
    Markers,
    {
        "constants": prepare_points,
        "position": place_points,
        "velocity": move_points,
        "bias": bias_rigid,
        "axes": complete_points,
    },
)


@dataclass
class MarkerTable:
    """Table of markers under construction; equal markers share a row and its part of the pool."""

    bodies: list[str]
    pool: Pool
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    numbers_of: dict[tuple[Any, ...], int] = field(default_factory=dict)
    modes: dict[bytes, int] = field(default_factory=dict)
    framed: set[int] = field(default_factory=set)  # markers of which axes are needed
    origin: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))  # of the equations
    references: Sequence[Sequence[float]] = ()  # points (3,) of the bodies, as in `Layout`
    numbers: dict[str, int] = field(init=False)  # of the bodies by name

    def __post_init__(self) -> None:
        self.numbers = {name: k for k, name in enumerate(self.bodies)}

    def add(self, marker: PlacedMarker, point: bool = False) -> int:
        """Index of the marker; `point`: the caller needs only its position."""
        row = self._row(marker)
        body, modes, bend, _, _, rho, arm, R = row
        key = body, modes, bend, rho.tobytes(), arm.tobytes(), R.tobytes()
        if key not in self.numbers_of:
            self.numbers_of[key] = len(self.rows)
            self.rows.append(row)
        if not point:
            self.framed.add(self.numbers_of[key])
        return self.numbers_of[key]

    def frame_together(self, pairs: Sequence[tuple[int, int]]) -> None:
        """If the axes of one marker of a pair are needed, mark those of the other as well."""
        partners: dict[int, set[int]] = {}
        for i, j in pairs:
            partners.setdefault(i, set()).add(j)
            partners.setdefault(j, set()).add(i)
        self.framed |= {k for k, row in enumerate(self.rows) if row[1] >= 0}  # moved by modes
        waiting = list(self.framed)
        while waiting:
            new = partners.get(waiting.pop(), set()) - self.framed
            self.framed |= new
            waiting.extend(new)

    def add_unshared(self, marker: PlacedMarker) -> int:
        """Index of a new row for this marker alone, as for one that slides along a curve."""
        self.rows.append(self._row(marker))
        self.framed.add(len(self.rows) - 1)
        return len(self.rows) - 1

    def _row(self, marker: PlacedMarker) -> tuple[Any, ...]:
        body = self.numbers.get(marker.body, -1)
        modes = self._modes(marker)
        rho, arm = marker.rho, marker.arm
        if modes < 0:  # no mode moves it
            rho, arm = marker.position, np.zeros(3)
        if body >= 0 and len(self.references):
            rho = rho - self.references[body]
        bend = self._bend(marker) if modes >= 0 else (-1, 0, np.zeros(3))
        return body, modes, *bend, rho, arm, marker.R

    def body(self, marker: int) -> int:
        """Body of a marker, -1 for ground."""
        return self.rows[marker][0]

    def on_ground(self) -> NDArray[np.float64]:
        """Positions (n, 3) of the markers on ground so far."""
        return np.array([row[5] for row in self.rows if row[0] < 0]).reshape(-1, 3)

    def _modes(self, marker: PlacedMarker) -> int:
        if marker.Phi_t is None or marker.Phi_r is None or marker.Phi_t.shape[1] == 0:
            return -1
        both = np.vstack([marker.Phi_t, marker.Phi_r])
        key = marker.body.encode() + both.tobytes()
        if key not in self.modes:
            self.modes[key] = self.pool.add(both)
        return self.modes[key]

    def _bend(self, marker: PlacedMarker) -> tuple[int, int, NDArray[np.float64]]:
        """Pool offset of the forms of a marker, -1: none, how many they are, and their axis."""
        if marker.bend is None or marker.Phi_r is None:
            return -1, 0, np.zeros(3)
        forms, axis = bend_with_axis(marker.bend, np.abs(marker.Phi_r).max())
        key = b"bend " + marker.body.encode() + forms.tobytes()
        if key not in self.modes:
            self.modes[key] = self.pool.add(rows_of_bend(forms))
        return self.modes[key], len(forms), axis

    def table(self) -> NDArray[np.void]:
        """MARKER rows."""
        table = np.zeros(len(self.rows), MARKER)
        if self.rows:
            table["point"] = [
                k not in self.framed and row[1] < 0 for k, row in enumerate(self.rows)
            ]
            names = ("body", "modes", "bend", "forms", "turn", "rho", "arm", "R")
            for k, name in enumerate(names):
                table[name] = [row[k] for row in self.rows]
            table["rho"][table["body"] < 0] -= self.origin
        return table
