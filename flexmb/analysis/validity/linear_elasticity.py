"""Limits of linear elasticity about a rigid motion: deflection, rotation and speed.

In: rows of a run, in order. Out: indicators of flexible bodies that bend or twist too far for small
deformations, and of those that rotate so fast that omitted centrifugal stiffening would change
their frequencies; the rows in which bodies rotate fastest, in which that is known better than by
their speed. The deflection is relative to the joints of the body, the speed that of the joints over
the lowest natural frequency of the body as joined, others at rest, of those that the motion has.
Vibrations are those with the mass of others; their accelerations tell which the motion has.
Sources of the bounds: Adams/Flex limits linear bodies to a tenth of their length; Kane, Ryan &
Banerjee, Dynamics of a cantilever beam attached to a moving base, J. Guidance 10 (1987) 139, for
the loss of stiffness of linear equations: the first frequency of a cantilever is too low by the
share 0.6 (Ω/ω₁)².
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.initial_state import StartValues
from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, ConstraintRows
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.analysis.monitors import Indicator
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns
from flexmb.errors import AssemblyError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array
from flexmb.flexbody.natural_modes import NaturalModes, natural_modes
from flexmb.model.excitation import marker_interface
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock

#: Deflection over the length of a body above which linear elasticity is doubtful.
LARGEST_DEFLECTION = 0.1
#: Largest relative error of a frequency by omitted centrifugal stiffening.
LARGEST_SOFTENING = 0.01
#: Rotation of points [rad] above which displacements off their axis are wrong by 5 %.
LARGEST_ROTATION = 0.3
#: Text on a body without stiffening that rotates faster than it vibrates.
INCONSISTENT = "an inconsistent set of equations, centrifugal softening without stiffening"
_MAX_SPEED_RATIO = 0.5**0.5  # Ω/ω at which rotation halves the stiffness
_SOFTENING = 0.6  # share of the first frequency of a cantilever that is lost, over (Ω/ω₁)²
#: Speed over the lowest frequency below which centrifugal stiffening may be left out.
LEAST_SPEED = (LARGEST_SOFTENING / _SOFTENING) ** 0.5
#: Such a speed below which nothing else tells it either; over the largest, that of a row as fast.
SLOW, _SAME_SPEED = 0.4 * LEAST_SPEED, 0.98
_MOST_STATES = 4  # in which changes of frequencies are computed; of other bodies the speed tells
_MAX_POINTS = 64  # largest number of points of a body that are monitored
_MIN_AMPLITUDE = 0.05  # amplitude of a mode over the largest one, if the motion contains it
_ZERO_FREQUENCY = 1e-5  # frequency over the highest one below which a motion is free
_CLAMPS = ("fixed", "prismatic")  # joints that constrain all rotations


class _Modes(NamedTuple):
    """Natural modes of a body as it is joined."""

    frequencies: Array  # (j,) ascending, rad/s
    amplitudes: Array  # (j, m) largest deflection over the length of each mode, per unit eta

    @classmethod
    def of(cls, body: FlexBody, deflection: Array, modes: tuple[Array, Array]) -> _Modes:
        """From frequencies and shapes (m, j), displacements of points (3 k, m) over the length."""
        frequencies, shapes = modes
        moved = (deflection @ shapes).reshape(len(deflection) // 3, 3, len(frequencies))
        sizes = np.linalg.norm(moved, axis=1).max(axis=0, initial=0.0)
        return cls(frequencies, sizes[:, None] * (shapes.T @ body.K) / frequencies[:, None] ** 2)


@dataclass(frozen=True, eq=False)
class _MonitoredBody:
    """A flexible body: displacements of points relative to its joints; its modes as joined."""

    columns: BodyColumns
    deflection: Array  # (3 k, m) displacements of points per unit eta, over its length
    rotation: Array  # (3 k, m) rotations of points per unit eta, rad
    turn: Array  # (3, m) rotation of the frame of its joints per unit eta, rad
    inertia: Array  # (3, 3) about the centre of mass, over the largest principal one
    at_rest: _Modes  # with all other bodies at rest
    in_scene: _Modes  # with the mass of other bodies, which are rigid
    is_stiffened: bool  # whether geometric stiffening is included
    coupling: str  # of its inertia

    @property
    def softens(self) -> bool:
        """Whether the equations contain centrifugal softening."""
        return self.coupling != "constant"

    def speeds(self, v: Array) -> Array:
        """(t,) angular velocities of its joints, less about the axis of a shaft."""
        iv = self.columns.iv + 3
        omega = v[:, iv : iv + 3] + v[:, iv + 3 : iv + 3 + self.columns.m] @ self.turn.T
        squares = np.einsum("ti,ij,tj->t", omega, self.inertia, omega)
        return np.asarray(np.sqrt(squares.clip(0.0)))


class LinearElasticityMonitor:
    """Monitors deflections, rotations and speeds of all flexible bodies.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions.
    is_motion : bool
        Whether the rows are a motion, not separate equilibria.
    every_mode : bool
        Whether the speed is over the lowest of all frequencies, not of those in the motion.
    """

    def __init__(
        self,
        compiled: Compiled,
        model: Model,
        q: Array,
        is_motion: bool = True,
        *,
        every_mode: bool = False,
    ) -> None:
        self._units, every = model.units, list(range(len(compiled.layout.bodies)))
        self._bodies, Cq, scene = list[_MonitoredBody](), None, None
        for columns, body in flexible_columns(compiled):
            Cq = constraint_jacobian(compiled, q) if Cq is None else Cq
            inertia = body.inertia_about_center
            inertia = inertia / np.linalg.eigvalsh(inertia)[-1]
            frame = joined_frame(body, columns.name, model)
            deflection, rotation = relative_motion(body, frame)
            modes = joined_modes(body, columns, q, Cq)
            at_rest = in_scene = _Modes.of(body, deflection, modes)
            with suppress(AssemblyError):  # motions without inertia
                if len(Cq):
                    scene = scene or MechanismModes(compiled, q, every, every_mass=True)
                    own = scene.vibrations(compiled.layout.bodies.index(columns))
                    in_scene = _Modes.of(body, deflection, (own.omega, own.eta))
            stiffened, spec = body.centrifugal_stiffness is not None, model.bodies[columns.name]
            coupling = getattr(spec, "inertia_coupling", "full")
            motions = columns, deflection, rotation, frame.turn, inertia, at_rest, in_scene
            self._bodies.append(_MonitoredBody(*motions, stiffened, coupling))
        n = len(self._bodies)
        self._largest = np.zeros((3, 2, n))  # deflection, rotation, speed: the value, and its time
        self._parts, self._amplitudes = _parts([one.at_rest for one in self._bodies])
        self._own, self._vibrations = _parts([one.in_scene for one in self._bodies])
        words = [getattr(model.bodies[one.columns.name], "deformation", "") for one in self._bodies]
        self._vibrate = [is_motion and word != "quasi-static" for word in words]
        self._every_mode = every_mode
        self._nq = compiled.layout.nq  # of the row in which each body rotates fastest: t, q, v
        self._fastest = np.zeros((n, 1 + compiled.layout.nq + compiled.layout.nv))

    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        for k, one in enumerate(self._bodies):
            iq, m = one.columns.iq + 7, one.columns.m
            eta, speed = rows.q[:, iq : iq + m], one.speeds(rows.v)
            amplitude = np.abs(eta @ one.at_rest.amplitudes.T).max(axis=0)
            present = self._amplitudes[self._parts[k]]
            np.maximum(present, amplitude, out=present)
            amplitude, iv = eta @ one.in_scene.amplitudes.T, one.columns.iv + 6
            if self._vibrate[k]:  # what follows a load does not vibrate
                amplitude = rows.vd[:, iv : iv + m] @ one.in_scene.amplitudes.T
                amplitude /= one.in_scene.frequencies**2
            present = self._vibrations[self._own[k]]
            np.maximum(present, np.abs(amplitude).max(axis=0), out=present)
            now = (largest_lengths(eta, one.deflection), largest_lengths(eta, one.rotation), speed)
            for largest, values in zip(self._largest, now, strict=True):
                row = int(values.argmax())
                if values[row] > largest[0, k]:
                    largest[:, k] = values[row], rows.t[row]
                    if values is speed:
                        self._fastest[k] = np.hstack([rows.t[row], rows.q[row], rows.v[row]])

    def fast_states(self) -> Iterator[tuple[StartValues, list[str]]]:
        """States in which bodies rotate fast that leave out terms of rotation; their names.

        Of the fastest bodies, since each state takes a linearisation of the whole model.
        """
        lowest = (one.in_scene.frequencies.min(initial=np.inf) for one in self._bodies)
        fast = [(self._largest[2, 0, k] / one, k) for k, one in enumerate(lowest)]
        left = [k for ratio, k in sorted(fast, reverse=True) if ratio > SLOW]
        left = [k for k in left if not self._has_all_terms(k)]
        for _ in range(_MOST_STATES):
            if not left:
                return
            t, q, v = np.split(self._fastest[left[0]], [1, 1 + self._nq])
            names, rest = [left[0]], list[int]()
            for k in left[1:]:
                is_fast = self._bodies[k].speeds(v[None])[0] >= _SAME_SPEED * self._largest[2, 0, k]
                (names if is_fast else rest).append(k)
            yield StartValues(q, v, float(t[0])), [self._bodies[k].columns.name for k in names]
            left = rest

    def contains(self, name: str, shapes: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """Whether the motion contains vibrations of a body with these shapes (nv, k)."""
        k = next(k for k, one in enumerate(self._bodies) if one.columns.name == name)
        one = self._bodies[k]
        first = one.columns.iv + 6
        parts = np.abs(one.in_scene.amplitudes @ shapes[first : first + one.columns.m]) ** 2
        there = self._vibrations[self._own[k]] > _MIN_AMPLITUDE * self._largest[0, 0, k]
        return np.asarray(2.0 * parts[there].sum(axis=0) >= parts.sum(axis=0))

    def _has_all_terms(self, k: int) -> bool:
        return self._bodies[k].is_stiffened and self._bodies[k].coupling == "full"

    def _present(self, k: int) -> NDArray[np.bool_]:
        """Which modes of a body, as joined, the motion contains."""
        amplitudes = self._amplitudes[self._parts[k]]
        least = -1.0 if self._every_mode else _MIN_AMPLITUDE * amplitudes.max(initial=0.0)
        return np.asarray(amplitudes > least)

    def _ratio(self, k: int) -> float:
        """Largest speed of a body over the lowest frequency that its motion contains."""
        lowest = self._bodies[k].at_rest.frequencies[self._present(k)].min(initial=np.inf)
        return float(self._largest[2, 0, k] / lowest)

    def indicators(self) -> Iterator[Indicator]:
        """Deflection, rotation and speed of each body."""
        for k, one in enumerate(self._bodies):
            name = one.columns.name
            (deflection, at), (rotation, turned), (speed, spun) = self._largest[:, :, k]
            ratio = 0.0 if one.is_stiffened else self._ratio(k)
            text = partial(self._softening, name, speed, ratio, spun, one.softens)
            quantity = "speed" if one.softens else "speed, of constant inertia"
            yield Indicator(name, quantity, ratio, spun, LEAST_SPEED, text)
            text = partial(self._deflected, name, deflection, at, ratio * one.softens)
            yield Indicator(name, "deflection", deflection, at, LARGEST_DEFLECTION, text)
            text = partial(self._rotated, name, rotation, turned)
            yield Indicator(name, "rotation", rotation, turned, LARGEST_ROTATION, text)

    def diverging(self) -> str:
        """The sentence on a body whose equations lose most stiffness by its rotation, or ""."""
        speeds = (one for one in self.indicators() if one.quantity == "speed")
        return next((one.text() for one in speeds if one.value > _MAX_SPEED_RATIO), "")

    def _deflected(self, name: str, deflection: float, t: float, ratio: float) -> str:
        what = f"bodies.{name} is deflected by {deflection:.2g} of its length at"
        if ratio > _MAX_SPEED_RATIO:
            cure = f'{INCONSISTENT}, and diverges; reduce it with geometric_stiffening = "full"'
            return f"{what} t = {self._units.say(t, 's', 4)}: {cure}"
        return (
            f"{what} t = {self._units.say(t, 's', 4)}: linear elasticity holds up to about "
            f"{LARGEST_DEFLECTION:g}; divide the body into several that are joined, or "
            "make it stiffer"
        )

    def _rotated(self, name: str, rotation: float, t: float) -> str:
        error = 50.0 * rotation**2
        return (
            f"bodies.{name} is turned within itself by {rotation:.2g} rad at "
            f"t = {self._units.say(t, 's', 4)}: what lies off its axis moves on straight lines, "
            f"which are too long by {error:.2g} %; divide the body into several that are joined"
        )

    def _softening(self, name: str, speed: float, ratio: float, t: float, softens: bool) -> str:
        where = f"bodies.{name} turns with {self._units.say(speed, 'rad/s', 3)}"
        share = f"{ratio:.2g} of its lowest natural frequency as it is joined"
        why = "centrifugal stiffening is left out"
        if not softens:
            loss = 100 * _SOFTENING * ratio**2
            error = f"frequencies across its plane of rotation are too low by about {loss:.2g} %"
        elif ratio >= 1.0:
            error = "rotation takes a part of its stiffness, all of it in a frame at the axis: "
            error += INCONSISTENT
        else:
            error = f"that frequency is too low by about {100 * _SOFTENING * ratio**2:.2g} %"
            error += f": {INCONSISTENT}" if ratio > _MAX_SPEED_RATIO else ""
        return (
            f"{where}, {share} (t = {self._units.say(t, 's', 4)}): {why}, so that {error}; reduce "
            'the body with geometric_stiffening = "full"'
        )


def _parts(modes: list[_Modes]) -> tuple[list[slice], Array]:
    """The part of each body in an array of amplitudes, and this array of zeros."""
    ends = np.cumsum([0, *(len(one.frequencies) for one in modes)])
    return [slice(*pair) for pair in pairwise(ends)], np.zeros(ends[-1])


def largest_lengths(eta: Array, rows: Array) -> Array:
    """(t,) largest length of the k vectors rows (3 k, m) · eta (t, m)."""
    moved = (eta @ rows.T).reshape(len(eta), len(rows) // 3, 3)
    return np.asarray(np.sqrt(np.einsum("tki,tki->tk", moved, moved).max(axis=1, initial=0.0)))


def flexible_columns(compiled: Compiled) -> Iterator[tuple[BodyColumns, FlexBody]]:
    """The bodies with modes, with their columns in q and v."""
    for columns in compiled.layout.bodies:
        body = compiled.bodies.get(columns.name)
        if columns.m and body is not None and body.m == columns.m:
            yield columns, body


def joined_modes(body: FlexBody, columns: BodyColumns, q: Array, Cq: Array) -> tuple[Array, Array]:
    """Natural modes of a body as it is joined, all other bodies at rest.

    Parameters
    ----------
    body, columns : FlexBody, BodyColumns
        The body, and its columns in q and v.
    q : (nq,) array
        Positions.
    Cq : (nc, nv) array
        Constraint Jacobian there.

    Returns
    -------
    frequencies : (j,) array
        Ascending [rad/s]; without free motions.
    shapes : (m, j) array
        Modal coordinates of the body in each, of unit modal mass.
    """
    modes = joined_motions(body, columns, q, Cq)
    vibrates = modes.frequencies > _ZERO_FREQUENCY * modes.frequencies.max(initial=0.0)
    return 2.0 * np.pi * modes.frequencies[vibrates], modes.eta[:, vibrates]


def joined_motions(body: FlexBody, columns: BodyColumns, q: Array, Cq: Array) -> NaturalModes:
    """All motions that the joints leave a body, all others at rest; also those without stiffness.

    Parameters as of `joined_modes`.
    """
    from scipy.spatial.transform import Rotation

    iq, iv = columns.iq, columns.iv
    rows = np.array(Cq[:, iv : iv + 6 + body.m])
    rows = rows[np.abs(rows).max(axis=1, initial=0.0) > 0.0]
    e0, e1, e2, e3 = q[iq + 3 : iq + 7]
    rows[:, :3] = rows[:, :3] @ Rotation.from_quat([e1, e2, e3, e0]).as_matrix()
    return natural_modes(body, rows=rows)


def constraint_jacobian(compiled: Compiled, q: Array) -> Array:
    """Cq (nc, nv) at the positions q; without rows if the model is too large."""
    if compiled.layout.nv > MAX_COORDINATES:
        return np.zeros((0, compiled.layout.nv))
    return ConstraintRows(compiled).evaluate(q).Cq


def joined_interfaces(body: FlexBody, name: str, model: Model) -> dict[str, bool]:
    """Interfaces of a body with joints, in order; whether a joint constrains all rotations."""
    driven = {spec.joint for spec in model.drivers.values()}
    places: dict[str, bool] = {}
    for joint, spec in model.joints.items():
        for marker in spec.between:
            owner, _, place = marker.partition(".")
            place = marker_interface(model.bodies[name], place) or "" if owner == name else ""
            if any(place == one.name for one in body.interfaces):
                holds = spec.type in _CLAMPS or joint in driven
                places[place] = places.get(place, False) or holds
    return places


class JoinedFrame(NamedTuple):
    """The frame of a body's joints, which moves relative to its mean axes with the deformation."""

    origin: Array  # (3,) m
    shift: Array  # (3, m) displacement of the origin per unit eta
    turn: Array  # (3, m) rotation per unit eta

    def at(self, positions: Array) -> Array:
        """(k, 3, m) displacement of the frame at positions (k, 3), per unit eta."""
        arms = (positions - self.origin)[:, None]
        return self.shift + np.cross(self.turn.T[None], arms).transpose(0, 2, 1)


def joined_frame(body: FlexBody, name: str, model: Model) -> JoinedFrame:
    """The frame of the first clamped interface; otherwise that of the straight line between the two
    joined interfaces that are farthest apart; otherwise the mean axes."""
    places = joined_interfaces(body, name, model)
    points = [body.interface(place) for place in places]
    clamped = [body.interface(place) for place, holds in places.items() if holds]
    if clamped:
        return JoinedFrame(clamped[0].position, clamped[0].Phi_t, clamped[0].Phi_r)
    still = np.zeros((3, body.m))
    if len(points) < 2:
        return JoinedFrame(np.zeros(3), still, still)
    first = points[0]
    far = max(points, key=lambda one: float(np.linalg.norm(one.position - first.position)))
    line = far.position - first.position
    square = float(line @ line)
    turn = np.cross(line, (far.Phi_t - first.Phi_t).T).T / square if square > 0.0 else still
    return JoinedFrame(first.position, first.Phi_t, turn)


def relative_motion(body: FlexBody, frame: JoinedFrame) -> tuple[Array, Array]:
    """Displacements of points of a body relative to its joints, over its length, and rotations of
    these points, both (3 k, m) per unit eta."""
    nodes = body.nodes
    positions = np.array([one.position for one in body.interfaces]).reshape(-1, 3)
    modes = np.array([one.Phi_t for one in body.interfaces]).reshape(-1, 3, body.m)
    turns = np.array([one.Phi_r for one in body.interfaces]).reshape(-1, 3, body.m)
    if nodes is not None:
        every = max(1, len(nodes.ids) // _MAX_POINTS)
        positions = np.vstack([positions, nodes.position[::every]])
        modes = np.concatenate([modes, nodes.Phi_t[::every]])
        if nodes.Phi_r is not None:
            turns = np.concatenate([turns, nodes.Phi_r[::every]])
    size = float(np.linalg.norm(np.ptp(positions, axis=0))) if len(positions) else 0.0
    relative = (modes - frame.at(positions)).reshape(-1, body.m) / (size if size > 0.0 else 1.0)
    return relative, (turns - frame.turn).reshape(-1, body.m)


def carrier_node(body: FlexBody, rho: Array, Phi_t: Array) -> int:
    """The mesh node that carries a marker, or -1 - i of interface number i."""
    for i, part in enumerate(body.interfaces):
        if np.array_equal(part.position, rho) and np.array_equal(part.Phi_t, Phi_t):
            return -1 - i
    assert body.nodes is not None
    return int(body.nodes.ids[((body.nodes.position - rho) ** 2).sum(axis=1).argmin()])


def in_body_axes(p: Array, vectors: Array) -> Array:
    """(t, 3) global vectors in the axes of a body with the Euler parameters p (t, 4)."""
    e0, e = p[:, :1], p[:, 1:]
    across = np.cross(e, vectors)
    return np.asarray(vectors + 2.0 * (np.cross(e, across) - e0 * across))


def in_global_axes(p: Array, vectors: Array) -> Array:
    """(t, 3) the other way round."""
    return in_body_axes(p * [1.0, -1.0, -1.0, -1.0], vectors)
