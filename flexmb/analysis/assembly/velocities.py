"""Initial velocities: as prescribed at markers, and consistent with joints and drivers.

The first guess for each body is the rigid motion that fits its prescribed velocities best, without
rates of deformation. It is projected onto the constraints with the least change δᵀ M δ. For this, a
marker with a prescribed velocity has an additional point mass, and a body with a prescribed angular
velocity an additional inertia, 1e8 times that of the body, so that other velocities are changed.
The contribution of rates of deformation at markers is corrected iteratively.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from flexmb.engine.allocation import new_work
from flexmb.engine.bodies.marker import MarkerTable
from flexmb.engine.compile import Compiled, with_markers
from flexmb.engine.compiled_calls import stage_solver
from flexmb.engine.initial_conditions import BEGIN, VELOCITIES
from flexmb.engine.state import State
from flexmb.engine.tables import MARKER, Pool, System
from flexmb.flexbody.arrays import Array
from flexmb.model import lookup
from flexmb.model.body import InitialVelocity
from flexmb.model.markers import rotation_matrix
from flexmb.model.model import Model

_PENALTY_MASS = 1e8  # mass at a marker with prescribed velocity over that of its body
_MAX_ROUNDS = 5  # each reduces the difference by a factor of ten or more, if it can be reduced
_REPORTED_CHANGE = 1e-6  # relative change of prescribed velocities above which there is a note
_DISTINCT = 1e-9  # distance over the size of the model below which markers are one point


@dataclass(frozen=True)
class _Prescribed:
    """Prescribed velocities at one marker: their scene path, rows in the tables."""

    where: str  # scene path before the word
    body: int
    marker: int
    spec: InitialVelocity

    def turned(self, values: Iterable[float], R: Array) -> Array:
        """Global components; R (3, 3) are the present axes of the marker."""
        components = np.array(tuple(values))
        return R @ components if self.spec.axes == "body" else components


class InitialVelocities:
    """The velocities a scene prescribes at its markers.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model.
    metric : System
        The system whose mass matrix measures changes of velocities.
    """

    def __init__(self, compiled: Compiled, model: Model, metric: System) -> None:
        self._length, self._units = compiled.length, model.units
        self._bodies = compiled.layout.bodies
        markers = MarkerTable(
            list(model.bodies), Pool([metric.parts.pool], metric.parts.pool.size),
            references=compiled.layout.references,
        )  # fmt: skip
        before = len(metric.parts.markers)
        self._prescribed = [
            _Prescribed(
                f"bodies.{name}.{f'initial.{marker}.' if marker in spec.initial else ''}",
                markers.numbers[name],
                before
                + markers.add(lookup.place_marker(model, f"{name}.{marker}", compiled.flexbodies)),
                one,
            )
            for name, spec in model.bodies.items()
            for marker, one in spec.initial_velocities.items()
        ]
        table = np.zeros(before + len(markers.rows), MARKER)
        table[:before], table[before:] = metric.parts.markers, markers.table()
        self._system = self._anchored(with_markers(metric, table, markers.pool.array()))
        self._work = new_work(self._system)
        self._handed: tuple[State, Callable[[], float], Callable[[], float]] | None = None

    def set(self, state: State) -> None:
        """Set the velocities of a state with closed positions."""
        project = self._solvers(state)[1]
        if not self._prescribed:
            state.v[:] = 0.0
            project()
            return
        self._measure(state)
        wanted = self._wanted()
        aim = wanted.copy()
        left = np.inf
        for n in range(_MAX_ROUNDS):
            before, missed = state.v.copy(), left
            state.v[:] = self._guess(state, aim)
            project()
            self._measure(state)
            missing = wanted - self._present()
            left = self._size(missing)
            if n > 0 and not left < 0.5 * missed:
                state.v[:] = before
                break
            aim += missing
        self._measure(state)

    def notes(self, state: State) -> list[str]:
        """Notes on prescribed velocities that had to change."""
        if not self._prescribed:
            return []
        self._measure(state)
        wanted, present = self._wanted(), self._present()
        scale = max(self._size(wanted), self._size(present), 1e-12)
        notes = []
        for one, change in zip(self._prescribed, np.abs(present - wanted).max(axis=2), strict=True):
            for word, off, reach, unit in (
                ("velocity", change[0], 1.0, "m/s"),
                ("angular_velocity", change[1], self._length, "rad/s"),
            ):
                if off * reach > _REPORTED_CHANGE * scale:
                    notes.append(
                        f"{one.where}{word} does not fit the joints, the drivers or other "
                        f"prescribed velocities; changed by up to {self._units.say(off, unit, 3)}"
                    )
        return notes

    def _anchored(self, system: System) -> System:
        """The system with penalty masses where velocities are prescribed."""
        bodies = system.parts.bodies.copy()
        for one in self._prescribed:
            row, light = bodies[one.body], system.parts.bodies[one.body]
            marker = system.parts.markers[one.marker]
            if one.spec.velocity is not None:
                mass, s = _PENALTY_MASS * light["mass"], marker["rho"] + marker["arm"]
                row["mass"] += mass
                row["S1"] += mass * s
                row["S0"] += mass * np.outer(s, s)
            if one.spec.angular_velocity is not None:
                row["S0"] += _PENALTY_MASS * np.trace(light["S0"]) * np.eye(3)
        return system._replace(parts=system.parts._replace(bodies=bodies))

    def _measure(self, state: State) -> None:
        """MarkerTable as they are and move in this state; the state is left as it is."""
        self._solvers(state)[2]()

    def _solvers(self, state: State) -> tuple[State, Callable[[], float], Callable[[], float]]:
        """For a state, which is handed over once: projection of its v, and its markers."""
        if self._handed is None or self._handed[0] is not state:
            aside = state._replace(power=state.power.copy(), angles=state.angles.copy())
            project, begin = (stage_solver(self._system, s, self._work) for s in (state, aside))
            self._handed = state, partial(project, VELOCITIES), partial(begin, BEGIN)
        return self._handed

    def _wanted(self) -> Array:
        """(n, 2, 3) prescribed velocity and angular velocity of each marker, global; NaN: none."""
        wanted = np.full((len(self._prescribed), 2, 3), np.nan)
        for one, row in zip(self._prescribed, wanted, strict=True):
            R = self._work.now.marker[one.marker]["R"]
            for k, values in enumerate((one.spec.velocity, one.spec.angular_velocity)):
                if values is not None:
                    row[k] = one.turned(values, R)
        return wanted

    def _present(self) -> Array:
        """(n, 2, 3) present velocity and angular velocity of each marker, global."""
        which = np.array([one.marker for one in self._prescribed], dtype=np.int64)
        rows = self._work.now.marker[which]
        return np.stack([rows["vx"], rows["om"]], axis=1)

    def _size(self, velocities: Array) -> float:
        """Largest of (n, 2, 3) velocities [m/s], angular ones times the size of the model."""
        sizes = np.abs(velocities) * np.array([1.0, self._length])[:, None]
        return float(np.nanmax(sizes, initial=0.0))

    def _guess(self, state: State, aim: Array) -> Array:
        """v (nv) of rigid motions that fit the velocities `aim` (n, 2, 3)."""
        v: Array = np.zeros_like(state.v)
        of_body: dict[int, list[int]] = {}
        for k, one in enumerate(self._prescribed):
            of_body.setdefault(one.body, []).append(k)
        for index, mine in of_body.items():
            body = self._bodies[index]
            x = self._work.now.marker["x"][[self._prescribed[k].marker for k in mine]]
            r = state.q[body.iq : body.iq + 3]
            velocity, spin = rigid_motion(x - r, aim[mine, 0], aim[mine, 1], self._length)
            A: Array = rotation_matrix(tuple(state.q[body.iq + 3 : body.iq + 7]))
            v[body.iv : body.iv + 3] = velocity
            v[body.iv + 3 : body.iv + 6] = A.T @ spin
        return v


def rigid_motion(s: Array, velocities: Array, spins: Array, length: float) -> tuple[Array, Array]:
    """The rigid motion that fits velocities of points best, with the least angular velocity.

    Parameters
    ----------
    s : (k, 3) float
        The points, relative to the origin of the body [m].
    velocities, spins : (k, 3) float
        Velocity [m/s] and angular velocity [rad/s] of each, in the same axes; NaN: not prescribed.
        If no velocity is prescribed, the points shall be at rest.
    length : float
        Factor of angular velocities in the comparison with velocities [m].

    Returns
    -------
    (3,), (3,) float
        Velocity of the origin and angular velocity, by least squares.
    """
    finite = ~np.isnan(velocities[:, 0])
    moved = np.where(finite[:, None], velocities, 0.0)
    points = finite if finite.any() else np.ones(len(s), dtype=bool)
    center, mean = s[points].mean(axis=0), moved[points].mean(axis=0)
    arms = s[finite] - center
    x, y, z = arms.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]])  # ω × arm = cross ω
    turns = spins[~np.isnan(spins[:, 0])]
    rows = np.concatenate(
        [np.moveaxis(cross, 2, 0).reshape(-1, 3), *[length * np.eye(3)] * len(turns)]
    )
    right = np.concatenate([(moved[finite] - mean).ravel(), length * turns.ravel()])
    U, size, Vt = np.linalg.svd(rows, full_matrices=False)
    share = np.divide(U.T @ right, size, out=np.zeros_like(size), where=size > _DISTINCT * length)
    spin = Vt.T @ share
    return mean - np.cross(spin, center), spin
