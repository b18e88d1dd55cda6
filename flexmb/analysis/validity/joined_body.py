"""Flexible bodies as the mechanism holds them: compliance, motion of sensors, bars with a bow.

A bar under an axial force N(x) has the geometric stiffness Kg = ∫ N w'ᵢ w'ⱼ dx, with w' the slopes
of its modes in the body frame (Timoshenko & Gere, Theory of Elastic Stability, §1.11). A shear
force V and a moment M add the second variation of −½∫ (V·θ) φ + M·(θ × θ') dx, with θ the rotation
of the sections and φ its part about the axis: the curvature θ' − θ × θ'/2 of a section in its own
axes (Simo & Vu-Quoc, Comput. Methods Appl. Mech. Eng. 58 (1986) 79). By these a deep beam buckles
sideways and twists. N has two parts: the forces at markers with the inertia of the bar, which are
in equilibrium along its axis, and the tension of a bow. With a bow the joined ends of a bar b
approach each other by δ = ∫ w'²/2 dx. Where joints or other bars prevent it, tensions T = P δ stay,

    P = diag(k) − k S C Sᵀ k,

with k the axial stiffness between the ends of each bar, S the motion of these ends apart per unit
of all modes, and C the compliance of these in the mechanism: k of a bar whose ends are held, 0 if
they are free; bars in series share their bows. The body frame of mean axes turns with a deflection,
and so the engine has a part of the geometric stiffness, Kj − Kg with Kj by the slopes relative to
the joints. A row has the deformation η of all bars, C F = (1 + C (Kj − Kg)) η for a load F, all
bodies in equilibrium; with stiffening it is η' = (1 + C K)⁻¹ C F, K = Kj with the stiffness of T.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from flexmb.analysis.assembly.jacobian import ConstraintRows, Decomposition, column_scales
from flexmb.analysis.validity.buckling import Loads
from flexmb.analysis.validity.linear_elasticity import (
    flexible_columns,
    joined_frame,
    joined_interfaces,
    largest_lengths,
    relative_motion,
)
from flexmb.analysis.validity.load_factor import longest_axis
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.static_response import LEAST_MOTION
from flexmb.model.excitation import marker_interface
from flexmb.model.flexible_body import stretches
from flexmb.model.model import Model
from flexmb.model.reading import GROUND

_DEPENDENT = 1e-9  # compliance of a set of joint rows, over the largest, that has no meaning
# Ratio of second moments of mass across and along a body, and distance of its middle line from a
# straight one over its length, up to which it bends as a bar.
_SLENDER, _STRAIGHT = 0.3, 0.05
DIVISIONS = 24  # of a bar along its axis; its slopes are those between their ends
_SAME_PLACE = 5e-3  # nodes closer along the axis than this share of the length are averaged
_ITERATIONS, _SOLVED = 60, 1e-6  # of Newton's method for the tensions; relative change at the end
# Change of a bar by its own stiffness over that by all bars, below which only the former is its.
_OWN = 0.1


class ModalCompliance:
    """Compliance of modes in the mechanism: eta per modal force, all bodies in equilibrium.

    With G η = 0 what the joints demand of the modes, whatever the bodies do, it is
    K⁻¹ − K⁻¹ Gᵀ (G K⁻¹ Gᵀ)⁺ G K⁻¹.
    """

    def __init__(self, compiled: Compiled) -> None:
        self._rows, self._scales = ConstraintRows(compiled), column_scales(compiled)
        self._weights = compiled.system.row_weights
        every = list(flexible_columns(compiled))
        self._places = np.concatenate(
            [columns.iv + 6 + np.arange(columns.m) for columns, _ in every]
        )
        self._rigid = np.setdiff1d(np.flatnonzero(self._scales > 0.0), self._places)
        self._inverse = block_diag(*(np.linalg.inv(body.K) for _, body in every))
        ends = np.cumsum([0, *(columns.m for columns, _ in every)])
        names = [columns.name for columns, _ in every]
        self._parts = {name: slice(ends[k], ends[k + 1]) for k, name in enumerate(names)}

    def turns(self, q: Array, columns: BodyColumns) -> Array:
        """(3, m) rotation of the frame of a body, in body axes, with which joints hold its modes;
        what they leave free stays as it is."""
        A, rows = self._at(q)
        back = rows.U[:, : rows.rank].T @ A[:, self._places[self._parts[columns.name]]]
        moved = rows.V[:, : rows.rank] @ (back / rows.S[: rows.rank, None])
        motion = np.zeros((len(self._scales), columns.m))
        motion[self._rigid] = -self._scales[self._rigid, None] * moved
        return motion[columns.iv + 3 : columns.iv + 6]

    def _at(self, q: Array) -> tuple[Array, Decomposition]:
        A = self._weights[:, None] * self._rows.evaluate(q).Cq
        return A, Decomposition.of(A[:, self._rigid] * self._scales[self._rigid])

    def of(self, q: Array, names: Iterable[str]) -> Array:
        """(m, m) of all modes of these bodies in the pose q."""
        A, rows = self._at(q)
        G = rows.U[:, rows.rank :].T @ A[:, self._places]
        between = G @ self._inverse @ G.T
        size = np.sqrt(between.diagonal().clip(1e-300))
        stiffness = np.linalg.pinv(between / np.outer(size, size), rcond=_DEPENDENT, hermitian=True)
        taken = (G @ self._inverse) / size[:, None]
        C = self._inverse - taken.T @ stiffness @ taken
        own = np.concatenate([np.arange(len(C))[self._parts[name]] for name in names])
        return np.asarray(C[np.ix_(own, own)])


def position_sensors(
    compiled: Compiled, model: Model, columns: BodyColumns, body: FlexBody
) -> Iterator[tuple[Array, Array]]:
    """Channels of each position sensor on a body, and the motion of its marker (3 k, m).

    That is relative to the joints; of a marker that is no interface it is that of all points. A
    body that is joined to an interface moves with it.
    """
    frame, channels = joined_frame(body, columns.name, model), compiled.layout.channels
    names = [one.name for one in body.interfaces]
    places: dict[str, set[str]] = {}  # of this body's interfaces, by the bodies joined there
    for joint in model.joints.values():
        for here, there in (joint.between, joint.between[::-1]):
            owner, _, place = here.partition(".")
            one = marker_interface(model.bodies[owner], place) if owner == columns.name else None
            if one in names:
                places.setdefault(there.partition(".")[0], set()).add(one or "")
    for name, spec in model.sensors.items():
        if spec.type != "position":
            continue
        numbers = [k for k, one in enumerate(channels) if one.partition(".")[0] == name]
        for marker in (getattr(spec, "of", None), getattr(spec, "relative_to", None)):
            owner, _, place = (marker or "").partition(".")
            moved = places.get(owner, set())
            if owner == columns.name:
                moved = {marker_interface(model.bodies[owner], place) or ""}
            if owner == columns.name and not moved <= set(names):
                yield np.array(numbers), relative_motion(body, frame)[0] * body_length(body)
            elif owner != GROUND:
                for at in map(body.interface, sorted(moved)):
                    yield np.array(numbers), at.Phi_t - frame.at(at.position[None])[0]


def largest_sensor_change(
    body: FlexBody, sensors: Iterable[tuple[Array, Array]], ranges: Array, change: Array
) -> float | None:
    """Largest change of position sensors over their range, by a change (m,) of the deformation.

    Parameters
    ----------
    body : FlexBody
        The body.
    sensors : iterable
        As of `position_sensors`.
    ranges : (n,) array
        Of all channels in the run so far; () before the first row.
    change : (m,) array
        Of the modal coordinates.

    Returns
    -------
    float or None
        None if no such sensor moves.
    """
    changes = []
    for channels, motion in sensors if ranges.ndim else ():
        size = float(np.linalg.norm(ranges[channels]))
        if size > LEAST_MOTION * body.characteristic_length:
            changes.append(float(largest_lengths(change[None], motion)[0]) / size)
    return max(changes, default=None)


def body_length(body: FlexBody) -> float:
    """Length over which displacements of `relative_motion` are."""
    assert body.nodes is not None
    positions = np.vstack([body.nodes.position, *(one.position for one in body.interfaces)])
    return float(np.linalg.norm(np.ptp(positions, axis=0)))


@dataclass(frozen=True, eq=False)
class SlenderBar:
    """A slender body without geometric stiffening, divided along its axis."""

    columns: BodyColumns
    body: FlexBody
    number: int  # in the tables of the engine
    axis: Array  # (3,) in body axes
    ends: Array  # (s + 1,) of the divisions, along the axis from the centre of mass, m
    mass: Array  # (2, s) of the divisions, and of these beyond their middles, kg
    slopes: Array  # (s, 2, m) in the body frame per unit eta
    joined: Array  # (s, 2, m) relative to the joints
    turns: Array  # (2, s, 3, m) rotations in the body frame, and relative to the joints
    twists: Array  # (s, 3, m) by which they change along a division
    bow: Array  # (m, m) of unit force between the joined ends; zero without two of these
    span: Array  # (m,) by which these ends move apart, m per unit eta
    points: Array  # (3 k, m) displacements relative to the joints, over the length
    is_mean_axis: bool  # its frame; in one at an interface moments lack N times the deflection
    sensors: tuple[tuple[Array, Array], ...]  # channels; (3 k, m) motion of their markers

    def stiffness(self, loads: Array) -> tuple[Array, Array]:
        """(t, m, m) geometric stiffness of forces and moments (t, s, 6) in the divisions, by the
        motion relative to the joints, and what the engine has of it."""
        own, joined = (
            self._along(loads, slopes) + self._across(loads, turns)
            for slopes, turns in zip((self.slopes, self.joined), self.turns, strict=True)
        )
        return joined, joined - own

    def _along(self, loads: Array, slopes: Array) -> Array:
        """(t, m, m) of the axial forces, by slopes (s, 2, m)."""
        weights = (loads[..., :3] @ self.axis) * np.diff(self.ends)
        return np.asarray(np.tensordot(weights, slopes.transpose(0, 2, 1) @ slopes, 1))

    def _across(self, loads: Array, turns: Array) -> Array:
        """(t, m, m) of the shear forces and moments, by rotations (s, 3, m)."""
        V, M = loads[..., :3] * np.diff(self.ends)[:, None], loads[..., 3:]
        V = V - (V @ self.axis)[..., None] * self.axis
        about = np.einsum("sai,a->si", turns, self.axis)
        bent = np.cross(turns[..., :, None], self.twists[..., None, :], axis=1)
        K = np.einsum("tsa,sai,sj->tij", V, turns, about, optimize=True)
        K = -0.5 * (K + np.tensordot(M, bent, ((1, 2), (0, 1))))
        return np.asarray(K + K.transpose(0, 2, 1))

    def rolled(self, turn: Array) -> SlenderBar:
        """The bar whose frame rolls about its axis as it turns (3, m) with the joints."""
        own, joined = self.turns
        roll = np.einsum("sai,a->si", own - joined, self.axis) + self.axis @ turn
        return replace(self, turns=np.stack([own, joined + self.axis[:, None] * roll[:, None]]))

    def shortening(self, eta: Array) -> Array:
        """(t,) by which its bow brings its joined ends together, with deformations eta (t, m)."""
        return np.asarray(0.5 * np.einsum("ti,ij,tj->t", eta, self.bow, eta))

    def load_factors(self, loads: Array, root: Array) -> Array:
        """(2, t) of axial forces, and of all forces and moments (t, s, 6).

        root rootᵀ is the compliance of the modes.
        """
        along = self._along(loads, self.joined)
        every = np.stack([along, along + self._across(loads, self.turns[1])])
        return np.asarray(np.linalg.eigvalsh(-root.T @ every @ root)[..., -1].clip(0.0))

    def section_loads(self, loads: Loads, on: IntArray, gravity: Array) -> Array:
        """(t, s, 6) force and moment on the near side of the middle of each division, body axes.

        They are those at its markers `on` and of its inertia; along the axis positive if the bar is
        pulled.
        """
        iv = self.columns.iv + 3
        A, w, alpha = loads.A[:, self.number], loads.v[:, iv : iv + 3], loads.vd[:, iv : iv + 3]
        middle = 0.5 * (self.ends[:-1] + self.ends[1:])
        arms = self.body.center + middle[:, None] * self.axis
        far = np.einsum("ti,tij->tj", loads.vd[:, iv - 3 : iv] - gravity, A)
        turned = np.cross(alpha[:, None], arms) + np.cross(w[:, None], np.cross(w[:, None], arms))
        a = far[:, None] + turned
        inertia, outer = (a * mass[:, None] for mass in self.mass)
        beyond = inertia.sum(axis=1, keepdims=True) - np.cumsum(inertia, axis=1) + outer
        W = np.concatenate([loads.wrenches[:, on, :3] @ A, loads.wrenches[:, on, 3:] @ A], axis=2)
        W[..., 3:] += np.cross(loads.s[:, on] - self.body.center, W[..., :3])
        places = (loads.s[:, on] - self.body.center) @ self.axis
        sums = np.einsum("tks,tka->tsa", places[:, :, None] > middle, W)
        # about the centre of mass; of the inertia as of forces at the middles
        moved = np.cross(middle[:, None] * self.axis, inertia)
        turning = moved.sum(axis=1, keepdims=True) - np.cumsum(moved, axis=1)
        sums[..., 3:] -= turning + np.cross(middle[:, None] * self.axis, outer)
        sums[..., :3] -= beyond
        sums[..., 3:] -= np.cross(middle[:, None] * self.axis, sums[..., :3])
        return np.asarray(sums)


def bars_without_stiffening(
    compiled: Compiled, model: Model, slender: float = _SLENDER
) -> Iterator[SlenderBar]:
    """The straight slender bodies without geometric stiffening.

    `slender` is the ratio of second moments of mass across and along them up to which they count.
    """
    numbers = compiled.system.parts.bodies["iv"]
    for columns, body in flexible_columns(compiled):
        axis, length = longest_axis(body, slender)
        if body.centrifugal_stiffness is not None or not length or body.nodes is None:
            continue
        if stretches(model.bodies[columns.name]):
            continue
        number = int(np.flatnonzero(numbers == columns.iv)[0])
        frame = joined_frame(body, columns.name, model)
        along = (body.nodes.position - body.center) @ axis
        if np.ptp(along) <= _SAME_PLACE * length:  # a beam that is wider than long
            continue
        ends = np.linspace(along.min(), along.max(), DIVISIONS + 1)
        across = np.linalg.svd(axis[None])[2][1:]
        middle = _means(body.nodes.position @ across.T, along, ends)
        if np.ptp(middle, axis=0).max() > _STRAIGHT * (ends[-1] - ends[0]):
            continue
        moved = _means(across @ body.nodes.Phi_t, along, ends)
        slopes = np.diff(moved, axis=0) / np.diff(ends)[:, None, None]
        joined_slopes = slopes - across @ np.cross(frame.turn.T, axis).T
        turned = np.zeros((DIVISIONS + 1, 3, columns.m))
        if body.nodes.Phi_r is not None:
            turned = _means(body.nodes.Phi_r, along, ends)
        turns = 0.5 * (turned[1:] + turned[:-1])
        turns = np.stack([turns, turns - frame.turn * (turned != 0.0).any()])
        bow, span = np.zeros((columns.m,) * 2), np.zeros(columns.m)
        joined = [body.interface(place) for place in joined_interfaces(body, columns.name, model)]
        if len(joined) > 1:
            places = np.array([(one.position - body.center) @ axis for one in joined])
            a, b = int(places.argmin()), int(places.argmax())
            inside = np.clip(
                np.minimum(ends[1:], places[b]) - np.maximum(ends[:-1], places[a]), 0, None
            )
            bow = np.einsum("s,sai,saj->ij", inside.clip(0.0), slopes, slopes)
            span = axis @ (joined[b].Phi_t - joined[a].Phi_t)
        frame_of = getattr(model.bodies[columns.name], "frame_interface", None)
        points = relative_motion(body, frame)[0]
        sensors = tuple(position_sensors(compiled, model, columns, body))
        yield SlenderBar(
            columns, body, number, axis, ends, masses_along(body, axis, ends), slopes,
            joined_slopes, turns, np.diff(turned, axis=0), bow, span, points, frame_of is None,
            sensors,
        )  # fmt: skip


def _means(values: Array, along: Array, ends: Array) -> Array:
    """(s + 1, ...) means across the axis of values (k, ...) at nodes, at the `ends`."""
    step = _SAME_PLACE * (ends[-1] - ends[0])
    _, group, count = np.unique(
        np.round((along - ends[0]) / step), return_inverse=True, return_counts=True
    )
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, group, values)
    means, places = sums.reshape(len(count), -1).T / count, np.bincount(group, along) / count
    at = np.array([np.interp(ends, places, one) for one in means])
    return at.T.reshape(len(ends), *values.shape[1:])


def masses_along(body: FlexBody, axis: Array, ends: Array) -> Array:
    """(2, s) masses of the divisions of a bar, and the parts of them beyond their middles.

    The divisions are between `ends` (s + 1,) from the centre of mass. Masses per length are linear
    along the axis; masses at both ends, or one at the middle, give the centre and the second moment
    of the body.
    """
    length, center = ends[-1] - ends[0], -0.5 * (ends[0] + ends[-1])  # of mass, from the middle
    x = 0.5 * (ends[:-1] + ends[1:]) + center
    S = body.S0 - np.outer(body.S1, body.S1) / body.mass
    second = float(axis @ S @ axis) / length**2 + body.mass * (center / length) ** 2
    at_ends = min(6.0 * second - 0.5 * body.mass, body.mass)
    lumps, more = np.zeros(len(x)), 0.0
    if at_ends > 0.0:
        more = float(np.clip(2.0 * body.mass * center / length, -at_ends, at_ends))
        lumps[[0, -1]] = 0.5 * (at_ends - more), 0.5 * (at_ends + more)
    else:
        lumps[len(x) // 2 - 1] = -2.0 * at_ends
    rest, first = body.mass - lumps.sum(), body.mass * center - 0.5 * more * length
    weights = np.maximum(rest + 12.0 * first * x / length**2, 0.0)
    spread = weights * (rest / max(weights.sum(), 1e-300))
    return np.array([lumps + spread, np.append(0.0, lumps[1:]) + 0.5 * spread])


def bow_stiffness(bars: Sequence[SlenderBar], compliance: Array) -> Array:
    """P (n, n) of the tensions P δ by which bars prevent their bows' shortening δ [N/m]."""
    S = block_diag(*(one.span for one in bars))
    free = np.array([one.span @ np.linalg.solve(one.body.K, one.span) for one in bars])
    k = np.divide(1.0, free, out=np.zeros(len(bars)), where=free > 0.0)
    P = np.diag(k) - k[:, None] * (S @ compliance @ S.T) * k
    values, X = np.linalg.eigh(0.5 * (P + P.T))
    return np.asarray((X * values.clip(0.0)) @ X.T)


def changes(
    bars: Sequence[SlenderBar], loads: Sequence[Array], eta: Sequence[Array], compliance: Array
) -> tuple[list[Array], Array]:
    """Changes (m,) of the deformations of bars by their loads (s, 6) and bows; tensions of these.

    What other bars change is included where a bar's own stiffness has a part in its change.
    """
    ends = np.cumsum([0, *(len(one) for one in eta)])
    parts = [slice(*pair) for pair in pairwise(ends)]
    pairs = [one.stiffness(force[None]) for one, force in zip(bars, loads, strict=True)]
    K, own = (block_diag(*(pair[k][0] for pair in pairs)) for k in (0, 1))
    now, one, P = np.concatenate(eta), np.eye(ends[-1]), bow_stiffness(bars, compliance)
    bows = [np.zeros_like(K) for _ in bars]
    for bow, bar, part in zip(bows, bars, parts, strict=True):
        bow[part, part] = bar.bow
    loaded, T = now + compliance @ own @ now, np.zeros(len(bars))
    for _ in range(_ITERATIONS):  # from below: δ(T) is convex, so that no step is too long
        both = K + sum(t * bow for t, bow in zip(T, bows, strict=True))
        bent, slopes = _bent(one + compliance @ both, loaded, compliance, bows)
        excess = T - P @ [0.5 * bent @ bow @ bent for bow in bows]
        step = np.linalg.solve(np.eye(len(T)) + P @ slopes, excess)
        T = T - step
        if np.abs(step).max() <= _SOLVED * np.abs(T).max():
            break
    forces = own @ now - both @ bent  # their responses C forces add up to the change
    each, whole = list[Array](), bent - now
    for part in parts:
        alone = compliance[part, part] @ forces[part]
        shared = np.linalg.norm(alone) >= _OWN * np.linalg.norm(whole[part])
        each.append(whole[part] if shared else alone)
    return each, np.asarray(T, float)


def _bent(
    both: Array, loaded: Array, compliance: Array, bows: Sequence[Array]
) -> tuple[Array, Array]:
    """Deformations (1 + C K)⁻¹ C F, and the rates (n, n) at which tensions lessen shortenings."""
    bent = np.linalg.solve(both, loaded)
    sides = np.array([bow @ bent for bow in bows])
    return np.asarray(bent), np.asarray(sides @ np.linalg.solve(both, compliance @ sides.T))
