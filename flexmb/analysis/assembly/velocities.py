"""First velocities: as asked for at markers, and consistent with joints and drivers.

Per body the rigid motion that suits what is asked of it is the first guess, flexible bodies without
rates of deformation. It is then put on the constraints with least change δᵀ M δ, where a marker of
given velocity carries a point mass, and a body of given angular velocity an inertia, 1e8 times that
of the body: others adapt to it. What rates of deformation add at a marker is made good in rounds.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import Compiled
from flexmb.engine.compile.core import with_markers
from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.pool import Pool
from flexmb.engine.entries import BEGIN, VELOCITIES, solve_level
from flexmb.engine.state import State
from flexmb.engine.tables import MARKER, System
from flexmb.engine.work import new_work
from flexmb.model import lookup
from flexmb.model.bodies.body import InitialVelocity
from flexmb.model.model import Model
from flexmb.model.values.orientation import rotation_matrix

__all__ = ["AskedVelocities", "rigid_motion"]

Array = NDArray[np.float64]

_HEAVY = 1e8
_ROUNDS = 5  # each shrinks what is missing by a factor of ten or more where it can be had
_KEPT = 1e-6  # asked-for velocities may change by this share before it is said
_APART = 1e-9  # of the model size: markers closer than this are one point


@dataclass(frozen=True)
class _Asked:
    """What is asked at one marker: its place in the scene, rows in the tables."""

    where: str
    body: int
    marker: int
    spec: InitialVelocity

    def turned(self, values: Iterable[float], R: Array) -> Array:
        """Components in global axes; R (3, 3) the marker's axes now."""
        given = np.array(tuple(values))
        return R @ given if self.spec.axes == "body" else given


class AskedVelocities:
    """The velocities a model asks for at its markers.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model, for velocities asked for.
    metric : System
        The system whose mass matrix measures changes of velocities.
    """

    def __init__(self, compiled: Compiled, model: Model, metric: System) -> None:
        self._length, self._units = compiled.length, model.units
        self._bodies = compiled.layout.bodies
        markers = Markers(list(model.bodies), Pool([metric.parts.pool], metric.parts.pool.size))
        before = len(metric.parts.markers)
        self._asked = [
            _Asked(
                _place(name, marker, marker in spec.initial),
                markers.numbers[name],
                before
                + markers.add(lookup.place_marker(model, f"{name}.{marker}", compiled.flexbodies)),
                asked,
            )
            for name, spec in model.bodies.items()
            for marker, asked in spec.asked_velocities.items()
        ]
        table = np.zeros(before + len(markers.rows), MARKER)
        table[:before], table[before:] = metric.parts.markers, markers.table()
        self._system = self._anchored(with_markers(metric, table, markers.pool.array()))
        self._work = new_work(self._system)

    def start(self, state: State) -> None:
        """Set v of a state with closed positions."""
        if not self._asked:
            state.v[:] = 0.0
            solve_level(self._system, state, self._work, VELOCITIES)
            return
        self._measure(state)
        wanted = self._wanted()
        aim = wanted.copy()
        left = np.inf
        for n in range(_ROUNDS):
            before, missed = state.v.copy(), left
            state.v[:] = self._guess(state, aim)
            solve_level(self._system, state, self._work, VELOCITIES)
            self._measure(state)
            missing = wanted - self._found()
            left = self._size(missing)
            if n > 0 and not left < 0.5 * missed:
                state.v[:] = before
                break
            aim += missing
        self._measure(state)

    def notes(self, state: State) -> list[str]:
        """What was asked for and could not be kept."""
        if not self._asked:
            return []
        self._measure(state)
        wanted, found = self._wanted(), self._found()
        scale = max(self._size(wanted), self._size(found), 1e-12)
        told = []
        for asked, change in zip(self._asked, np.abs(found - wanted).max(axis=2), strict=True):
            for word, off, reach, unit in (
                ("velocity", change[0], 1.0, "m/s"),
                ("angular_velocity", change[1], self._length, "rad/s"),
            ):
                if off * reach > _KEPT * scale:
                    told.append(
                        f"{asked.where}{word} does not fit the joints, the drivers or what else "
                        f"is asked; changed by up to {self._units.say(off, unit, 3)}"
                    )
        return told

    def _anchored(self, system: System) -> System:
        """The system with heavy bodies where a velocity is asked."""
        bodies = system.parts.bodies.copy()
        for asked in self._asked:
            row, light = bodies[asked.body], system.parts.bodies[asked.body]
            marker = system.parts.markers[asked.marker]
            if asked.spec.velocity is not None:
                mass, s = _HEAVY * light["mass"], marker["rho"] + marker["arm"]
                row["mass"] += mass
                row["S1"] += mass * s
                row["S0"] += mass * np.outer(s, s)
            if asked.spec.angular_velocity is not None:
                row["S0"] += _HEAVY * np.trace(light["S0"]) * np.eye(3)
        return system._replace(parts=system.parts._replace(bodies=bodies))

    def _measure(self, state: State) -> None:
        """Markers as they are and move in this state; the state is left as it is."""
        aside = state._replace(power=state.power.copy(), angles=state.angles.copy())
        solve_level(self._system, aside, self._work, BEGIN)

    def _wanted(self) -> Array:
        """(n, 2, 3) velocity and angular velocity asked at each marker, global; NaN: not asked."""
        wanted = np.full((len(self._asked), 2, 3), np.nan)
        for asked, row in zip(self._asked, wanted, strict=True):
            R = self._work.now.marker[asked.marker]["R"]
            for k, given in enumerate((asked.spec.velocity, asked.spec.angular_velocity)):
                if given is not None:
                    row[k] = asked.turned(given, R)
        return wanted

    def _found(self) -> Array:
        """(n, 2, 3) velocity and angular velocity of each marker now."""
        which = np.array([asked.marker for asked in self._asked], dtype=np.int64)
        rows = self._work.now.marker[which]
        return np.stack([rows["vx"], rows["om"]], axis=1)

    def _size(self, velocities: Array) -> float:
        """Largest of (n, 2, 3) velocities [m/s], angular ones at the model's size."""
        sizes = np.abs(velocities) * np.array([1.0, self._length])[:, None]
        return float(np.nanmax(sizes, initial=0.0))

    def _guess(self, state: State, aim: Array) -> Array:
        """v (nv) of rigid motions that suit the velocities `aim` (n, 2, 3)."""
        v: Array = np.zeros_like(state.v)
        asked_of: dict[int, list[int]] = {}
        for k, asked in enumerate(self._asked):
            asked_of.setdefault(asked.body, []).append(k)
        for index, mine in asked_of.items():
            body = self._bodies[index]
            x = self._work.now.marker["x"][[self._asked[k].marker for k in mine]]
            r = state.q[body.iq : body.iq + 3]
            velocity, spin = rigid_motion(x - r, aim[mine, 0], aim[mine, 1], self._length)
            A: Array = rotation_matrix(tuple(state.q[body.iq + 3 : body.iq + 7]))
            v[body.iv : body.iv + 3] = velocity
            v[body.iv + 3 : body.iv + 6] = A.T @ spin
        return v


def rigid_motion(s: Array, velocities: Array, spins: Array, length: float) -> tuple[Array, Array]:
    """The rigid motion that suits given velocities of points best, turning no more than needed.

    Parameters
    ----------
    s : (k, 3) float
        The points, from the origin of the body [m].
    velocities, spins : (k, 3) float
        Velocity [m/s] and angular velocity [rad/s] asked of each, one set of axes for all; NaN
        where nothing is asked. If no velocity is asked, the points are wanted at rest.
    length : float
        What an angular velocity is multiplied by to compare it with a velocity [m].

    Returns
    -------
    (3,), (3,) float
        Velocity of the origin and angular velocity, by least squares.
    """
    given = ~np.isnan(velocities[:, 0])
    moved = np.where(given[:, None], velocities, 0.0)
    points = given if given.any() else np.ones(len(s), dtype=bool)
    center, mean = s[points].mean(axis=0), moved[points].mean(axis=0)
    arms = s[given] - center
    x, y, z = arms.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]])  # ω × arm = cross ω
    told = spins[~np.isnan(spins[:, 0])]
    rows = np.concatenate(
        [np.moveaxis(cross, 2, 0).reshape(-1, 3), *[length * np.eye(3)] * len(told)]
    )
    right = np.concatenate([(moved[given] - mean).ravel(), length * told.ravel()])
    U, size, Vt = np.linalg.svd(rows, full_matrices=False)
    share = np.divide(U.T @ right, size, out=np.zeros_like(size), where=size > _APART * length)
    spin = Vt.T @ share
    return mean - np.cross(spin, center), spin


def _place(body: str, marker: str, initial: bool) -> str:
    """Scene path before the word, of what is asked at a marker."""
    return f"bodies.{body}." + (f"initial.{marker}." if initial else "")
