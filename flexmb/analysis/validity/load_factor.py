"""Load factor of stiffened flexible bodies in a run: their loads over those that buckle them.

That of each row of a run is computed by :mod:`flexmb.analysis.validity.buckling`. Above one linear
theory is not valid. So is by how much a natural frequency under the loads is too high for want of
modes that answer their geometric stiffness. Bodies without geometric stiffening are judged by
:mod:`flexmb.analysis.validity.omitted_stiffening`.

Waves along a bar neither buckle nor stiffen it: the mean over a vibration period counts. It is
exponential, of eight rows or more, and so lags where rows are rare. Then the value of a row counts
itself, if it is slow: the ends of the bar move apart between two rows by what the mean of both
rates says. In a vibration that is faster than the rows they do not.

Sources: Euler's columns, Timoshenko & Gere, Theory of Elastic Stability, §2.2; the relation of load
and frequency, f = f₀ √(1 − P/P_cr), Timoshenko, Vibration Problems in Engineering, §5.11.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, ConstraintRows, one_blas_thread
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.buckling import LoadedMechanism, Loads
from flexmb.analysis.validity.linear_elasticity import flexible_columns, joined_modes
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import stage_solver
from flexmb.engine.forces.load import LOAD
from flexmb.engine.initial_conditions import RESIDUAL
from flexmb.engine.state import State, Work
from flexmb.engine.tables import BodyColumns
from flexmb.errors import AssemblyError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.static_response import LARGEST_SHARE
from flexmb.model.excitation import loads_beside_interfaces
from flexmb.model.forces.load import BodyLoadSpec
from flexmb.model.lookup import place_marker
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

#: Load factor above which a run has a note.
NEAR_BUCKLING = 0.8
#: Error of a natural frequency under loads, for want of modes, above which a run has a note.
LARGEST_ERROR = 0.02
_EULER = 0.1  # Euler load of a pinned bar over ω₁² m L: 1/π²
# Rows are examined if a simple upper bound of the load exceeds this share of the warning level.
_MIN_ESTIMATE = 0.3
_MAX_ENTRIES = 2_000_000  # matrix entries of all rows that are examined together
_MAX_ROW_WEIGHT = 0.125  # largest weight of one row in the mean
_RARE_ROWS = 0.25  # share of a period between two rows from which on these are rare
_ROWS_AT_ONCE = 100  # rows whose means are computed together: the weight of the first is 1e-6
# What rates do not explain, over the change of the distance of the ends, from which on it is none
# of a slow motion.
_FAST = 0.3
_MOST_NAMES = 3  # named in a sentence
_NO_FREQUENCY = 10.0  # error from which on there is no such frequency


class LoadFactorMonitor:
    """Computes the load factor of each body with geometric stiffening along a run.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions.
    is_motion : bool
        Whether the rows are a motion, whose vibrations do not count; not separate equilibria.
    """

    def __init__(self, compiled: Compiled, model: Model, q: Array, is_motion: bool = True) -> None:
        self._compiled, self._units, self._is_motion = compiled, model.units, is_motion
        self._gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        self._bodies, periods = [], []
        if compiled.layout.nv <= MAX_COORDINATES:
            Cq = lowest = None
            for columns, body in flexible_columns(compiled):
                Cq = ConstraintRows(compiled).evaluate(q).Cq if Cq is None else Cq
                frequencies, _ = joined_modes(body, columns, q, Cq)
                _, length = longest_axis(body)
                if body.centrifugal_stiffness is None or not len(frequencies):
                    continue
                lowest = _lowest_frequency(compiled, q) if lowest is None else lowest
                euler = _EULER * min(frequencies[0], lowest) ** 2 * body.mass * length
                self._bodies.append((columns, body, euler, length))
                periods.append(2.0 * np.pi / frequencies[0])
        self._periods = np.array(periods)
        self._reactions = [
            [k for k, path in enumerate(compiled.layout.reactions) if _acts_on(model, path, name)]
            for name in (columns.name for columns, *_ in self._bodies)
        ]
        self._loaded = [
            sum(_is_on(spec, columns.name) for spec in model.forces.values()) > 1
            or any(
                isinstance(f, BodyLoadSpec) and f.body == columns.name
                for f in model.forces.values()
            )
            for columns, *_ in self._bodies
        ]
        # Columns: load factor of each body, then share of a frequency that more modes would take.
        self._largest = np.zeros((2, 2 * len(self._bodies)))
        self._mean = np.full_like(self._largest, np.nan)  # mean over a period, time of last row
        self._omega = np.zeros(len(self._bodies))  # that frequency [rad/s]
        self._stretches = [stretch(body, longest_axis(body)[0]) for _, body, *_ in self._bodies]
        self._last = np.full((len(self._bodies), 3), np.nan)  # as of `slow_shares`

    @cached_property
    def _scratch(self) -> tuple[State, Work, Callable[[int], float]]:
        system = self._compiled.system
        state, work = new_state(system), new_work(system)
        return state, work, stage_solver(system, state, work)

    @cached_property
    def _mechanism(self) -> LoadedMechanism:
        return LoadedMechanism(self._compiled, self._gravity, self._turning)

    @cached_property
    def _turning(self) -> NDArray[np.void]:
        """Rows of the torques, and of the forces whose components are in the axes of a marker."""
        kind = self._compiled.system.kinds.get("loads")
        rows = np.zeros(0, LOAD) if kind is None else kind.rows
        return np.asarray(rows[(rows["axes"] >= 0) | (rows["torque"] == 1)])

    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not self._bodies:
            return
        worth = np.zeros(len(rows.t), bool)
        for k, (columns, body, euler, length) in enumerate(self._bodies):
            force = np.abs(rows.lam).sum(axis=1)  # used if reactions are not stored
            if rows.reactions.size:
                parts = rows.reactions.reshape(len(rows.t), -1, 4, 3)[:, self._reactions[k], :2]
                force = (np.linalg.norm(parts, axis=3) @ [1.0, 1.0 / length]).sum(axis=1)
            far = np.linalg.norm(rows.vd[:, columns.iv : columns.iv + 3] - self._gravity, axis=1)
            load = force + body.mass * far
            worth |= (load > _MIN_ESTIMATE * NEAR_BUCKLING * euler) | self._loaded[k]
        n = len(self._bodies)
        values, omega = np.zeros((len(rows.t), 2 * n)), np.zeros(len(rows.t))
        values[worth], omega[worth] = self._values(rows, np.flatnonzero(worth))
        slow = np.zeros_like(values)
        for k, ((columns, *_), along) in enumerate(zip(self._bodies, self._stretches, strict=True)):
            now, self._last[k] = slow_shares(columns, along, rows, self._last[k])
            slow[:, [k, n + k]] = now[:, None]
        last = np.append(self._mean[1, :1], rows.t)
        periods = np.tile(self._periods, 2)
        passed = np.diff(last)[:, None] / periods if self._is_motion else None
        mean, means = period_means(self._mean[0], passed, values, slow)
        self._mean = np.array([mean, np.full_like(mean, rows.t[-1])])
        best = means.argmax(axis=0)
        largest = np.take_along_axis(means, best[None], axis=0)[0]
        larger = largest > self._largest[0]
        self._largest[:, larger] = largest[larger], rows.t[best[larger]]
        self._omega = np.where(larger[n:], omega[best[n:]], self._omega)

    def add_last(self, rows: OutputBlock) -> None:
        """Add the last row of a run that failed, without averaging."""
        if self._bodies:
            values = self._values(rows, np.zeros(1, np.int64))[0][0]
            values[len(self._bodies) :] = 0.0  # what modes would change is no cause of a failure
            larger = values > self._largest[0]
            self._largest[:, larger] = values[larger], np.full(larger.sum(), rows.t[0])

    def diverging(self) -> str:
        """The sentence on the first body that its loads have buckled, or ""."""
        for one in self.indicators():
            if one.quantity == "load_factor" and one.value > 1.0:
                return one.text()
        return ""

    def indicators(self) -> Iterator[Indicator]:
        """The load factor of each body, and the error of a frequency under loads."""
        for k, (columns, *_) in enumerate(self._bodies):
            value, t = self._largest[:, k]
            text = partial(self._sentence, columns.name, value, t)
            yield Indicator(columns.name, "load_factor", value, t, NEAR_BUCKLING, text)
            share, t = self._largest[:, len(self._bodies) + k]
            error = share / max(1.0 - share, np.finfo(float).tiny)
            text = partial(self._lacking, columns.name, self._omega[k], error, t)
            yield Indicator(columns.name, "loaded_frequency", error, t, LARGEST_ERROR, text)

    def _sentence(self, name: str, value: float, t: float) -> str:
        what = "linear theory ends at one; make it stiffer, or shorten it between its joints"
        return (
            f"bodies.{name}: at t = {self._units.say(t, 's', 4)} its loads are {value:.2g} of "
            f"those that buckle it: {what}"
        )

    def _lacking(self, name: str, omega: float, error: float, t: float) -> str:
        hertz = self._units.say(omega / (2.0 * np.pi), "Hz", 3)
        high = f"too high by {percent(error)}" if error < _NO_FREQUENCY else "none with all modes"
        return (
            f"bodies.{name}: its modes do not answer what its loads do to its stiffness at t = "
            f"{self._units.say(t, 's', 4)}: a natural frequency under them, {hertz}, is {high}; "
            "reduce it with more modes"
        )

    @one_blas_thread()
    def _values(self, rows: OutputBlock, which: IntArray) -> tuple[Array, Array]:
        """(rows, 2 bodies) values at the rows `which`, from the wrenches at all markers, and the
        frequency [rad/s] of which shares are lost."""
        parts = self._compiled.system.parts
        values, omega = np.zeros((len(which), 2 * len(self._bodies))), np.zeros(len(which))
        numbers = [int(np.flatnonzero(parts.bodies["iv"] == one[0].iv)[0]) for one in self._bodies]
        size = max(1, _MAX_ENTRIES // self._compiled.layout.nv**2)
        for first in range(0, len(which), size):
            part = slice(first, first + size)
            loads = self.loads(rows, which[part])
            factors, omega[part], shares = self._mechanism.load_factors(loads)
            values[part] = np.hstack([factors[:, numbers], shares[:, numbers]])
        return values, omega

    def loads(self, rows: OutputBlock, which: IntArray) -> Loads:
        """The wrenches at all markers at the rows `which`."""
        state, work, solve = self._scratch
        wrenches, arms, axes, places, frames, turning = [], [], [], [], [], []
        for row in which:
            state.t[0] = rows.t[row]
            for name in ("q", "v", "vd", "lam"):
                getattr(state, name)[:] = getattr(rows, name)[row]
            solve(RESIDUAL)
            wrenches.append(self._wrenches(work, state.lam))
            arms.append(work.now.marker["s"].copy())
            axes.append(work.now.body["A"].copy())
            places.append(work.now.marker["x"].copy())
            frames.append(work.now.marker["R"].copy())
            u, own = work.con.fun[self._turning["fun"], 0], self._turning["axes"][:, None, None]
            R = np.where(own >= 0, frames[-1][self._turning["axes"]], np.eye(3))
            turning.append(np.einsum("kij,kj->ki", R, self._turning["factor"] * u))
        q, v, vd, lam = (getattr(rows, name)[which] for name in ("q", "v", "vd", "lam"))
        every = wrenches, arms, axes, places, frames, turning
        W, s, A, x, R, F = (np.array(one) for one in every)
        return Loads(q, v, vd, W, s, A, x, R, lam, F)

    def _wrenches(self, work: Work, lam: Array) -> Array:
        """(markers, 6) wrenches, with those of point joints, which the engine does not store."""
        system = self._compiled.system
        W = work.now.marker["W"].copy()
        W[system.parts.markers["point"] == 1] = 0.0
        joints = system.kinds.get("point_joints")
        for group in () if joints is None else system.groups[joints.groups]:
            for r in range(group["row"], group["row"] + group["n"]):
                row = system.rows[r]
                W[row["I"], row["a"]] += lam[r]
                W[row["J"], row["a"]] -= lam[r]
        return np.asarray(W)


def _lowest_frequency(compiled: Compiled, q: Array) -> float:
    """Of all flexible bodies in the mechanism [rad/s]: a body on top of a column moves with it."""
    every = list(range(len(compiled.layout.bodies)))
    flexible = [k for k in every if compiled.layout.bodies[k].m]
    try:
        omega = MechanismModes(compiled, q, every).vibrations(*flexible).omega
    except AssemblyError:  # motions without inertia
        return 0.0
    return float(omega[0]) if len(omega) else 0.0  # none if all modes follow their loads


def longest_axis(body: FlexBody, ratio: float = np.inf) -> tuple[Array, float]:
    """Axis and length of a body; length 0 if second moments across and along it exceed a ratio."""
    S = body.S0 - np.outer(body.S1, body.S1) / body.mass
    values, axes = np.linalg.eigh(S)
    slender = values[1] < ratio * values[2]
    return axes[:, 2], float(np.sqrt(12.0 * values[2] / body.mass)) if slender else 0.0


def _acts_on(model: Model, path: str, body: str) -> bool:
    section, _, name = path.partition(".")
    return section == "joints" and _is_on(model.joints[name], body)


def _is_on(spec: object, body: str) -> bool:
    """Whether a joint or force acts at a marker of the body."""
    if isinstance(spec, BodyLoadSpec):
        return spec.body == body
    markers = getattr(spec, "between", None) or (getattr(spec, "at", None),)
    return any((marker or "").partition(".")[0] == body for marker in markers)


def stretch(body: FlexBody, axis: Array) -> Array:
    """(m,) by which the ends of a body move apart along an axis, per unit eta."""
    points, moved = (
        [one.position for one in body.interfaces],
        [one.Phi_t for one in body.interfaces],
    )
    if body.nodes is not None:
        points, moved = list(body.nodes.position), list(body.nodes.Phi_t)
    if not points:
        return np.zeros(body.m)
    places = np.array(points) @ axis
    return np.asarray(axis @ (moved[int(places.argmax())] - moved[int(places.argmin())]))


def slow_shares(
    columns: BodyColumns, along: Array, rows: OutputBlock, last: Array
) -> tuple[Array, Array]:
    """(t,) from 0 for vibrations faster than the rows to 1 for slow motions; the last row.

    `last` (3,) are the time, the stretch and its rate at the row before; NaN: none.
    """
    first, rate = columns.iq + 7, columns.iv + 6
    table = np.column_stack(
        [
            rows.t,
            rows.q[:, first : first + columns.m] @ along,
            rows.v[:, rate : rate + columns.m] @ along,
        ]
    )
    t, moved, rates = np.vstack([last, table]).T
    change = np.diff(moved)
    apart = np.abs(change - 0.5 * np.diff(t) * (rates[1:] + rates[:-1]))
    moves = np.abs(change) > 0.0
    share = np.divide(apart, np.abs(change), out=np.ones_like(apart), where=moves)
    return np.nan_to_num((1.0 - share / _FAST).clip(0.0)), table[-1]


def period_means(
    mean: Array, passed: Array | None, values: Array, slow: Array
) -> tuple[Array, Array]:
    """The mean after some rows, and the values (t, n) that count in each of them.

    Parameters
    ----------
    mean : (n,) array
        Mean up to the last row before; NaN: none yet.
    passed : (t, 1) or (t, n) array, optional
        Time since the row before, in periods; NaN in the first row if there was none. None:
        separate rows.
    values : (t, n) array
        Values of the rows.
    slow : (t, 1) or (t, n) array
        As of `slow_shares`.
    """
    if passed is None:
        return values[-1], values
    weights = np.broadcast_to(np.minimum(passed, _MAX_ROW_WEIGHT), values.shape)
    means = np.empty_like(values)
    begin = 0
    if np.isnan(passed[0]).any() or np.isnan(mean).any():
        means[0], mean, begin = values[0], values[0], 1
    for first in range(begin, len(values), _ROWS_AT_ONCE):
        part = slice(first, first + _ROWS_AT_ONCE)
        left = np.cumprod(1.0 - weights[part], axis=0)
        means[part] = left * (mean + np.cumsum(weights[part] * values[part] / left, axis=0))
        mean = means[part][-1]
    counts = np.where(passed > _RARE_ROWS, slow, 0.0)
    return mean, means + counts * (values - means)


def loads_without_response(compiled: Compiled, model: Model) -> Iterator[str]:
    """A sentence on each load of a body to which its modes have no response."""
    for name, spec in model.forces.items():
        if isinstance(spec, BodyLoadSpec) and compiled.flexbodies[spec.body].m:
            share = compiled.flexbodies[spec.body].load(spec.load).missing_share
            if share > LARGEST_SHARE:
                yield (
                    f"forces.{name}: the modes of bodies.{spec.body} lack {100 * share:.2g} % of "
                    f'the strain energy of its static response to the load "{spec.load}": leave '
                    "out its residual = false"
                )


def loads_without_stiffening(compiled: Compiled, model: Model) -> Iterator[str]:
    """A sentence on each stiffened body with joints and forces whose stiffening is not known.

    It is known at interfaces, and at those nodes with which the body was reduced.
    """
    for name, body in compiled.flexbodies.items():
        if not body.m or body.centrifugal_stiffness is None:
            continue
        beside = [
            one
            for one in loads_beside_interfaces(model)
            if one[1] == name and place_marker(model, one[2], compiled.flexbodies).bend is None
        ]
        loads, markers = (list(dict.fromkeys(one[k] for one in beside)) for k in (0, 2))
        whose = "its force does" if len(loads) == 1 else "their forces do"
        what, cure = "is no interface", "it one"
        if len(markers) > 1:
            what, cure = "are no interfaces", "them interfaces"
        if beside:
            yield (
                f"{_some(loads)}: {whose} not stiffen bodies.{name}, because {_some(markers)} "
                f"{what} of it; make {cure}, or reduce the body with its load_points"
            )


def _some(names: Sequence[str]) -> str:
    """The first names, and how many more."""
    most = _MOST_NAMES if len(names) > _MOST_NAMES + 1 else len(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
