"""What geometric stiffening would change in slender bodies, and at sensors, that are without it.

The deformation η of each row is compared with η', that with stiffening
(:mod:`flexmb.analysis.validity.joined_body`): η' − η is told at the position sensors on the body
and on bodies joined to it, over their range, and over the deflection.

The load factor, whether the forces would buckle the body, is the largest eigenvalue of −C Kj, with
C the compliance of its modes in the mechanism and Kj their geometric stiffness.

A stiffened body knows the displacements of second order of its interfaces and of those nodes with
which it was reduced. That of another node, where a sensor measures, is from an interface on
∫ θ × (θ × ds)/2, with the rotations θ of the nodes between.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from flexmb.analysis.assembly.initial_state import StartValues
from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, one_blas_thread
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.joined_body import (
    DIVISIONS,
    ModalCompliance,
    SlenderBar,
    bars_without_stiffening,
    bow_stiffness,
    changes,
    largest_sensor_change,
)
from flexmb.analysis.validity.linear_elasticity import (
    flexible_columns,
    in_body_axes,
    in_global_axes,
    largest_lengths,
)
from flexmb.analysis.validity.load_factor import (
    LoadFactorMonitor,
    period_means,
    slow_shares,
    stretch,
)
from flexmb.analysis.validity.pose_vibrations import OmittedTerms
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import Interface
from flexmb.flexbody.arrays import Array, skew
from flexmb.flexbody.parts import NodeModes
from flexmb.flexbody.static_response import LEAST_MOTION
from flexmb.model.lookup import place_marker
from flexmb.model.model import Model
from flexmb.model.sensor import MarkerSensorSpec
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

#: Change over the deflection of the body, and of a sensor over its range, from which a run says so.
LARGEST_CHANGE, LARGEST_SENSOR_CHANGE = 0.1, 0.01
#: Load factor of a body without geometric stiffening above which a run has a note.
LARGEST_LOAD_FACTOR = 0.1
_MIN_SHARE_OF_RUN = 0.1  # share of a run after which it may be refused
_VISIBLE = 1e-3  # change of a sensor below which that of the deflection does not matter
# Share of the largest first estimate so far from which on a row is computed exactly.
_WORTH = 0.5
_NEAR_NODES, _SHORT_STEPS = 13, 3.0  # of a way along a body; power of its lengths
_WIDE = 0.9  # second moment of mass across a blade over that along it, up to which it is a bar
_MOST_STATES = 4  # in which changes of frequencies are computed
_LEAST_RANGE = 0.01  # of a channel, over the largest of its sensor, below which it is not judged


class OmittedStiffeningMonitor:
    """Estimates what omitted geometric stiffening would change in slender bodies.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions.
    load_factor : LoadFactorMonitor
        It computes the forces at all markers.
    is_motion : bool
        Whether the rows are a motion, not separate equilibria.
    """

    def __init__(
        self,
        compiled: Compiled,
        model: Model,
        q: Array,
        load_factor: LoadFactorMonitor,
        is_motion: bool,
    ) -> None:
        self._units, self._loads, self._is_motion = model.units, load_factor.loads, is_motion
        self._gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        self._bars = (
            []
            if compiled.layout.nv > MAX_COORDINATES
            else list(bars_without_stiffening(compiled, model))
        )
        joints = {getattr(spec, "joint", "") for spec in model.sensors.values()
                  if spec.type == "reaction"}  # fmt: skip
        measured = [spec.between for name, spec in model.joints.items() if name in joints]
        self._measured = {end.partition(".")[0] for pair in measured for end in pair}
        n, most = len(self._bars), max((one.columns.m for one in self._bars), default=0)
        self._markers = [
            np.flatnonzero(compiled.system.parts.markers["body"] == one.number)
            for one in self._bars
        ]
        self._mechanism = mechanism = ModalCompliance(compiled) if n else None
        if mechanism is not None:
            self._bars = [one.rolled(mechanism.turns(q, one.columns)) for one in self._bars]
        whole = self._compliance(q)
        ends = np.cumsum([0, *(one.columns.m for one in self._bars)])
        self._first = [whole[a:b, a:b] for a, b in pairwise(ends)]
        self._bow_stiffness = bow_stiffness(self._bars, whole) if n else np.zeros((0, 0))
        self._roots = [_root(C) for C in self._first]
        self._periods = np.array(
            [_period(*pair) for pair in zip(self._bars, self._first, strict=True)]
        )
        self._forces = np.full((n, DIVISIONS * 6), np.nan)  # mean over a period
        self._last = np.full((n, 3), np.nan)  # as of `slow_shares`: time first
        self._deflection = np.zeros(n)  # largest so far, over the length
        self._about = np.zeros(n)  # first estimate of the row with the largest change
        self._change = np.zeros((n, most))  # of the modes, in the row where it is largest
        # largest so far and its time, of axial forces, and of all
        self._load_factors = np.zeros((2, 2, n))
        self._largest = np.zeros((4, n))  # deflection; time; forces; tension of a bow, N
        self._nq = compiled.layout.nq  # of the row of these: q, v
        self._states = np.zeros((n, compiled.layout.nq + compiled.layout.nv))
        self._least, self._most = np.array(np.inf), np.array(-np.inf)  # range of all channels
        duration = model.dynamics.duration if model.dynamics and is_motion else 0.0
        self._settled, self._begin = _MIN_SHARE_OF_RUN * duration, np.full(1, np.nan)

    @property
    def bows(self) -> set[str]:
        """Names of the bodies of which it knows the tension of their bow."""
        return {one.columns.name for one in self._bars if one.span.any()}

    @one_blas_thread()
    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not self._bars or not len(rows.t):
            return
        self._begin[:] = np.where(np.isnan(self._begin), rows.t[0], self._begin)
        if rows.sensors.shape[1]:
            self._least = np.minimum(self._least, rows.sensors.min(axis=0))
            self._most = np.maximum(self._most, rows.sensors.max(axis=0))
        loads = self._loads(rows, np.arange(len(rows.t)))
        firsts = [one.columns.iq + 7 for one in self._bars]
        etas = [
            rows.q[:, first : first + one.columns.m]
            for first, one in zip(firsts, self._bars, strict=True)
        ]
        now = (
            one.section_loads(loads, at, self._gravity)
            for one, at in zip(self._bars, self._markers, strict=True)
        )
        forces = [self._means(k, rows, one) for k, one in enumerate(now)]
        bows = [one.shortening(eta) for one, eta in zip(self._bars, etas, strict=True)]
        tensions = self._bow_stiffness @ np.array(bows)
        worth, about = set[int](), np.zeros((len(self._bars), len(rows.t)))
        for k, one in enumerate(self._bars):
            deflection = largest_lengths(etas[k], one.points)
            self._deflection[k] = max(self._deflection[k], deflection.max())
            C = self._first[k]
            for largest, factors in zip(
                self._load_factors, one.load_factors(forces[k], self._roots[k]), strict=True
            ):
                row = int(factors.argmax())
                if factors[row] > largest[0, k]:
                    largest[:, k] = factors[row], rows.t[row]
            K, own = one.stiffness(forces[k])
            load = etas[k] + np.einsum("tij,tj->ti", own, etas[k]) @ C
            both = np.eye(len(C)) + C @ (K + tensions[k][:, None, None] * one.bow)
            moved = np.linalg.solve(both, load[..., None])[..., 0] - etas[k]
            about[k] = np.minimum(largest_lengths(moved, one.points), 2 * deflection)
            best = np.argsort(-about[k])[:2]
            worth |= {int(row) for row in best if about[k, row] > _WORTH * self._about[k]}
        for row in sorted(worth):
            loaded = [one[row] for one in forces], [one[row] for one in etas]
            self._solve(rows, row, *loaded, about[:, row])

    def _compliance(self, q: Array) -> Array:
        """(m, m) of the modes of all bars in the pose q."""
        names = [one.columns.name for one in self._bars]
        return self._mechanism.of(q, names) if self._mechanism else np.zeros((0, 0))

    def _solve(
        self, rows: OutputBlock, row: int, loads: list[Array], etas: list[Array], about: Array
    ) -> None:  # fmt: skip
        """Compute the changes of one row, in its pose, and keep those that are the largest."""
        every = changes(self._bars, loads, etas, self._compliance(rows.q[row]))
        for k, (one, change, tension) in enumerate(zip(self._bars, *every, strict=True)):
            moved = float(largest_lengths(change[None], one.points)[0])
            if np.isfinite(moved) and moved > self._largest[0, k]:
                lengths = np.diff(one.ends)
                mean = float(loads[k][:, :3] @ one.axis @ lengths / lengths.sum())
                self._largest[:, k] = moved, rows.t[row], mean, tension
                self._about[k] = min(about[k], moved)
                self._change[k, : one.columns.m] = change
                self._states[k] = np.hstack([rows.q[row], rows.v[row]])

    def _means(self, k: int, rows: OutputBlock, forces: Array) -> Array:
        """(t, s, 6) means of the forces and moments over a vibration period."""
        one, last = self._bars[k], self._last[k]
        slow, end = slow_shares(one.columns, stretch(one.body, one.axis), rows, last)
        passed = np.diff(np.append(last[0], rows.t))[:, None] / self._periods[k]
        since = passed if self._is_motion else None
        table = forces.reshape(len(forces), -1)
        self._forces[k], means = period_means(self._forces[k], since, table, slow[:, None])
        self._last[k] = end
        return means.reshape(forces.shape)

    def indicators(self) -> Iterator[Indicator]:
        """The change of each body: at its sensors, or else over its deflection."""
        for k, one in enumerate(self._bars):
            (value, t), (every, then) = self._load_factors[:, :, k]
            # moments of both signs lessen a stiffness: by the square of their load factor
            level, sideways = LARGEST_LOAD_FACTOR, every * (every - value) > value
            if sideways or every > 1.0 >= value:
                value, t, level = every, then, LARGEST_LOAD_FACTOR**0.5
            text = partial(self._buckled, one.columns.name, value, t, level)
            yield Indicator(one.columns.name, "load_factor", value, t, level, text)
            moved, t, force, tension = self._largest[:, k]
            if moved <= LEAST_MOTION:
                continue
            share, seen = moved / self._deflection[k], self._sensor_change(k)
            bends = share > LARGEST_CHANGE and (
                seen is None or seen > _VISIBLE or not one.is_mean_axis
            )
            value, level = share, LARGEST_CHANGE
            if seen is not None and (seen > LARGEST_SENSOR_CHANGE or not bends):
                value, level = seen, LARGEST_SENSOR_CHANGE
            text = partial(self._sentence, one, share, seen, t, force, tension)
            early = self._last[k, 0] - self._begin[0] < self._settled
            bound = 0.0 if early else min(share, share if seen is None else seen)
            yield Indicator(one.columns.name, "stiffening", value, t, level, text, bound)

    def bent_states(self) -> Iterator[tuple[StartValues, list[str]]]:
        """States in which it changes the deflections of bars most, and their names.

        Of those bars whose forces sensors measure, and which it changes more than counts.
        """
        shares = self._largest[0] / np.maximum(self._deflection, LEAST_MOTION)
        for k in np.argsort(-shares)[:_MOST_STATES]:
            name = self._bars[k].columns.name
            if shares[k] > LARGEST_CHANGE and name in self._measured:
                q, v = np.split(self._states[k], [self._nq])
                yield StartValues(q, v, float(self._largest[1, k])), [name]

    def _sensor_change(self, k: int) -> float | None:
        """Largest change of the position sensors on the body, over their range; None: no sensor."""
        one = self._bars[k]
        change, ranges = self._change[k, : one.columns.m], self._most - self._least
        return largest_sensor_change(one.body, one.sensors, ranges, change)

    def _sentence(
        self,
        one: SlenderBar,
        share: float,
        seen: float | None,
        t: float,
        force: float,
        tension: float,
    ) -> str:
        at, say = self._units.say(t, "s", 4), partial(self._units.say, unit="N", digits=2)
        cause = f"it is {'pulled' if force > 0 else 'compressed'} with {say(abs(force))}"
        if tension > abs(force):
            cause = f"its joints hold the ends that its bow pulls together, with {say(tension)}"
        seen = seen or 0.0
        sensors = f" and a sensor by {percent(seen)} of its range" if seen > _VISIBLE else ""
        return (
            f"bodies.{one.columns.name}: geometric stiffening is left out, which would change its "
            f"deflection by about {percent(share)}{sensors} (t = {at}: {cause}); reduce it with "
            'geometric_stiffening = "full"'
        )

    def _buckled(self, name: str, value: float, t: float, level: float) -> str:
        what = f"it is compressed by about {value:.2g} of the load that buckles it"
        if level > LARGEST_LOAD_FACTOR:
            what = (
                f"it is bent by at least about {value:.2g} of the load by which it buckles sideways"
            )
        return (
            f"bodies.{name}: at t = {self._units.say(t, 's', 4)} {what}, yet its forces do not "
            'soften it; reduce it with geometric_stiffening = "full"'
        )


class OmittedBendMonitor:
    """Estimates what position sensors lack at nodes of stiffened bodies."""

    def __init__(self, compiled: Compiled, model: Model) -> None:
        self._units, self._channels = model.units, compiled.layout.channels
        self._size = compiled.length
        self._sensors = list(_sensors_without_bend(compiled, model))
        self._least, self._most = np.array(np.inf), np.array(-np.inf)  # range of all channels
        self._largest = np.zeros((len(self._sensors), 4))  # change along each axis, its time

    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not self._sensors or not len(rows.t):
            return
        self._least = np.minimum(self._least, rows.sensors.min(axis=0))
        self._most = np.maximum(self._most, rows.sensors.max(axis=0))
        self._largest = largest = self._largest.copy()
        for before, (_, columns, _, bend, seen) in zip(largest, self._sensors, strict=True):
            modes = slice(columns.iq + 7, columns.iq + 7 + columns.m)
            moved = np.einsum("ti,aij,tj->ta", rows.q[:, modes], bend, rows.q[:, modes])
            moved = in_global_axes(rows.q[:, columns.iq + 3 : columns.iq + 7], moved / 2)
            iq, R = seen
            moved = moved if iq < 0 else in_body_axes(rows.q[:, iq + 3 : iq + 7], moved)
            moved = np.abs(moved @ R)
            if moved.max() > before[:3].max():
                before[3] = rows.t[int(moved.max(axis=1).argmax())]
            before[:3] = np.maximum(before[:3], moved.max(axis=0))

    def indicators(self) -> Iterator[Indicator]:
        """What each sensor lacks, over the range of its channel."""
        ranges = np.broadcast_to(self._most - self._least, len(self._channels))
        for (name, columns, lacking, *_), (*change, t) in zip(
            self._sensors, self._largest, strict=True
        ):
            own = [k for k, one in enumerate(self._channels) if one.partition(".")[0] == name]
            least = max(_LEAST_RANGE * ranges[own].max(), LEAST_MOTION * self._size)
            axes = {k: "xyz".find(self._channels[k][-1]) for k in own if ranges[k] > least}
            share = max((float(change[axis] / ranges[k]) for k, axis in axes.items()), default=0.0)
            options = " ".join(f"--load-point {node}" for node in lacking)
            words = (
                f"sensors.{name}: how bodies.{columns.name} comes nearer as it bends is not known "
                f"at {' and '.join(f'node {node}' for node in lacking)}, about {percent(share)} of "
                f"the range of the sensor (t = {self._units.say(t, 's', 4)}); make interfaces "
                f"there, or reduce the body with load_points there (flexmb reduce {options})"
            )
            level = LARGEST_SENSOR_CHANGE
            yield Indicator(columns.name, "bend", share, t, level, partial(str, words))


def omitted_stiffness(
    compiled: Compiled, model: Model, row: OutputBlock, load_factor: LoadFactorMonitor
) -> Iterator[OmittedTerms]:
    """The geometric stiffness that bars lack in one row, and blades that are nearly as wide."""
    bars = list(bars_without_stiffening(compiled, model, _WIDE))
    if not bars:
        return
    loads, gravity = (
        load_factor.loads(row, np.zeros(1, np.int64)),
        np.array(model.gravity or (0, 0, 0)),
    )
    for bar in bars:
        on = np.flatnonzero(compiled.system.parts.markers["body"] == bar.number)
        whole, own = bar.stiffness(bar.section_loads(loads, on, gravity))
        first, none = bar.columns.iv + 6, np.zeros((bar.columns.m,) * 2)
        part = slice(first, first + bar.columns.m)
        cause = "geometric stiffening is left out"
        cure = 'reduce it with geometric_stiffening = "full"'
        yield OmittedTerms(bar.columns.name, cause, cure, part, none, none, (whole - own)[0])


def _sensors_without_bend(
    compiled: Compiled, model: Model
) -> Iterator[tuple[str, BodyColumns, list[int], Array, tuple[int, Array]]]:
    """Sensors at such nodes: name, body, nodes, about the bend (3, m, m) of what is
    measured less that of where from; the axes: the first column in q of a body, -1 of the ground,
    and a matrix (3, 3) in its axes."""
    first = {one.name: one.iq for one in compiled.layout.bodies}
    for columns, body in flexible_columns(compiled):
        nodes = body.nodes
        if body.centrifugal_stiffness is None or nodes is None or nodes.Phi_r is None:
            continue
        for name, spec in model.sensors.items():
            if not isinstance(spec, MarkerSensorSpec) or spec.type != "position":
                continue
            lacking, bend = list[int](), np.zeros((3, columns.m, columns.m))
            for sign, marker in ((1.0, spec.of), (-1.0, spec.relative_to or spec.seen_from or "")):
                if marker.partition(".")[0] != columns.name:
                    continue
                place = place_marker(model, marker, compiled.flexbodies)
                if place.bend is None and place.Phi_t is not None:
                    away = ((nodes.position - place.rho) ** 2).sum(axis=1)
                    lacking.append(int(nodes.ids[away.argmin()]))
                    bend += sign * _bend_beside_interfaces(
                        body.interfaces, nodes, nodes.Phi_r, place.rho
                    )
            if not lacking:
                continue
            axes = spec.axes if spec.seen_from is None else spec.seen_from
            R, owner = np.eye(3), axes.partition(".")[0]
            if axes != "global":
                R = place_marker(model, axes, compiled.flexbodies).R
            yield name, columns, lacking, bend, (first.get(owner, -1), R)


def _bend_beside_interfaces(
    interfaces: Sequence[Interface], nodes: NodeModes, turns: Array, place: Array
) -> Array:
    """About the (3, m, m) bend at a place, from that of the interface with the shortest way on.

    The way goes from node to near node, as the material does.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    x, tree = nodes.position, cKDTree(nodes.position)
    far, near = tree.query(x, k=min(_NEAR_NODES, len(x)))
    end, starts = int(tree.query(place)[1]), tree.query([one.position for one in interfaces])[1]
    rows = np.append(np.repeat(np.arange(len(x)), near.shape[1]), starts)
    lengths = np.append(far**_SHORT_STEPS, np.full(len(starts), len(x) * far.max() ** _SHORT_STEPS))
    columns = np.append(near, np.full(len(starts), end))  # a way even to what has no near nodes
    graph = coo_array((lengths, (rows, columns)), shape=(len(x), len(x))).tocsr()
    away, before = dijkstra(graph, directed=False, indices=end, return_predecessors=True)
    which = int(away[starts].argmin())
    way = [int(starts[which])]
    while way[-1] != end:
        way.append(int(before[way[-1]]))
    first, last, middle = turns[way[:-1]], turns[way[1:]], 0.5 * (turns[way[1:]] + turns[way[:-1]])
    Phi_r = np.concatenate([first, 2.0 * middle, last]) / 6.0**0.5
    steps = np.tile(np.diff(x[way], axis=0), (3, 1))
    both = np.einsum("jam,jcn,jc->amn", Phi_r, Phi_r, steps)
    both = 0.5 * (both + both.swapaxes(1, 2)) - np.einsum("ja,jcm,jcn->amn", steps, Phi_r, Phi_r)
    bend, arm = interfaces[which].bend, x[end] - x[starts[which]]
    assert bend is not None
    turned = -np.einsum("ab,bmn->amn", skew(arm), bend[3:])
    return np.asarray(bend[:3] + turned - both)


def _root(C: Array) -> Array:
    """A matrix R with R Rᵀ = C."""
    values, X = np.linalg.eigh(C)
    return np.asarray(X * np.sqrt(values.clip(0.0)))


def _period(bar: SlenderBar, compliance: Array) -> float:
    """About the longest period of a body as it is joined [s]."""
    largest = np.linalg.eigvals(compliance @ bar.body.M_eta)
    return float(2.0 * np.pi * np.sqrt(np.abs(largest).max(initial=0.0)))
