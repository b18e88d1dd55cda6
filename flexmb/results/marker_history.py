"""Motion of markers, joint coordinates and energies of modes, from the stored state of a run.

In: positions, velocities and accelerations from a result. Out: channels that no sensor recorded:
``rod.big_end.velocity.x`` (of a marker, global axes), ``crank_pin.angle`` and
``crank_pin.angle_rate`` (of a joint), ``rod.mode_energy.3`` (share of a mode in the strain energy).
Markers of flexible bodies move as in the time loop: p = r + A s, s = rho + Phi_t eta - 1/2 eta' K_d
eta + E arm, E = exp(Phi_r eta - 1/2 eta' K_d eta) (see `engine.bodies.marker`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flexmb.engine.joints.joint import SECOND_TURN, driver_row
from flexmb.flexbody.arrays import Array
from flexmb.model import Model
from flexmb.model.lookup import joint_frames, marker_names, place_marker
from flexmb.model.markers import PlacedMarker, rotation_matrices
from flexmb.model.reading import GROUND
from flexmb.model.scenes.conversion import reduced_scene
from flexmb.model.sensor import CHANNEL_UNITS
from flexmb.results.crash_safe_file import reading
from flexmb.results.reader import ResultReader

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody


_BATCH = 20_000  # rows per batch, which take some 20 MB
# rad^2: below this angle^2 the coefficients of the tangent map of rotation are computed by series
_SERIES = 0.3
MODE_ENERGY: Final = "mode_energy"
MOTIONS: Final = (
    "position", "velocity", "acceleration", "angular_velocity", "angular_acceleration",
)  # fmt: skip
_LEVELS = dict(zip(MOTIONS, (0, 1, 2, 1, 2), strict=True))  # number of time derivatives needed
_COORDINATES = {
    "angle": "rad", "angle_rate": "rad/s", "second_angle": "rad", "second_angle_rate": "rad/s",
    "stroke": "m", "stroke_rate": "m/s",
}  # fmt: skip
_RECOVERED = re.compile(
    rf".+\.(?:(?:{'|'.join(MOTIONS)})\.[xyz]"
    rf"|{'|'.join(_COORDINATES)}|{MODE_ENERGY}\.\d+)"
)


class MarkerMotion(NamedTuple):
    """Motion of a marker over k rows, global axes; None for derivatives that were not needed."""

    position: Array  # (k, 3)
    axes: Array  # (k, 3, 3) columns
    velocity: Array | None = None
    angular_velocity: Array | None = None
    acceleration: Array | None = None
    angular_acceleration: Array | None = None


class MotionChannel(NamedTuple):
    """A recovered channel: of a marker, of a joint, or of a mode of a flexible body."""

    owner: str  # "rod.big_end", "crank_pin", "rod"
    kind: str  # one of MOTIONS, of the coordinates of joints, or MODE_ENERGY
    number: int  # component or mode
    unit: str  # SI

    @property
    def name(self) -> str:
        """Such as ``rod.big_end.velocity.x``."""
        if self.kind in MOTIONS:
            return f"{self.owner}.{self.kind}.{'xyz'[self.number]}"
        end = f".{self.number}" if self.kind == MODE_ENERGY else ""
        return f"{self.owner}.{self.kind}{end}"


def motion_channels(
    result: ResultReader, model: Model, bodies: dict[str, FlexBody]
) -> Iterator[MotionChannel]:
    """All channels that can be recovered from what the run stored."""
    levels = {body.name: _stored_levels(result, body.name) for body in result.layout.bodies}
    levels[GROUND] = len(_TABLES)
    for body in levels:
        if body == GROUND:
            continue
        for marker in marker_names(model, body, bodies):
            for kind in MOTIONS:
                if _LEVELS[kind] < levels[body]:
                    unit = CHANNEL_UNITS[kind.replace("_", " ")]
                    for number in range(3):
                        yield MotionChannel(f"{body}.{marker}", kind, number, unit)
    for name, joint in model.joints.items():
        if joint.kind.coordinates:
            level = min(levels[reference.partition(".")[0]] for reference in joint.between)
            for coordinate in joint.kind.coordinates:
                for kind in (coordinate, f"{coordinate}_rate")[:level]:
                    yield MotionChannel(name, kind, 0, _COORDINATES[kind])
    for body, flexbody in bodies.items():
        if levels[body]:
            for number in range(flexbody.m):
                yield MotionChannel(body, MODE_ENERGY, number, "J")


_TABLES = ("q", "v", "vd")


def _stored_levels(result: ResultReader, body: str) -> int:
    """How many of position, velocity and acceleration of a body the run stored: 0 to 3."""
    for level, table in enumerate(_TABLES):
        if not result.has_columns(table, _place(result, body, table)):
            return level
    return len(_TABLES)


def _place(result: ResultReader, body: str, table: str) -> slice:
    columns = result.layout.body(body)
    if table == "q":
        return slice(columns.iq, columns.iq + 7 + columns.m)
    return slice(columns.iv, columns.iv + 6 + columns.m)


def is_recoverable(name: str) -> bool:
    """Whether a channel of this name would be recovered rather than stored."""
    return _RECOVERED.fullmatch(name) is not None


def motion_values(
    result: ResultReader, model: Model, bodies: dict[str, FlexBody], channel: MotionChannel
) -> Array:
    """The channel over all rows (n,), SI; angles are continuous over several revolutions."""
    n = len(result.time)
    values = np.empty(n)
    if channel.kind == MODE_ENERGY:
        first = result.layout.body(channel.owner).iq + 7
        eta = result.part("q", slice(first, first + bodies[channel.owner].m))
        row = bodies[channel.owner].K[channel.number]
        return np.asarray(0.5 * eta[:, channel.number] * (eta @ row))
    if channel.kind in MOTIONS:
        markers = [place_marker(model, channel.owner, bodies)]
        level = _LEVELS[channel.kind]
    else:
        I, J = joint_frames(model, channel.owner, bodies)  # noqa: E741
        if channel.kind.startswith("second"):
            I, J = replace(J, R=J.R @ SECOND_TURN), I  # noqa: E741
        axis = driver_row(model.joints[channel.owner].type, "angle")[2]
        markers = [I, J]
        level = int(channel.kind.endswith("_rate"))
    tables = [_state(result, marker.body, level) for marker in markers]
    for start in range(0, n, _BATCH):
        rows = slice(start, min(start + _BATCH, n))
        motions = [
            marker_motion(marker, *(table[rows] for table in state))
            if state
            else _at_rest(marker, rows.stop - start)
            for marker, state in zip(markers, tables, strict=True)
        ]
        if channel.kind in MOTIONS:
            values[rows] = getattr(motions[0], channel.kind)[:, channel.number]
        else:
            values[rows] = _joint_coordinate(channel.kind, axis, *motions)
    return np.unwrap(values) if channel.kind.endswith("angle") else values


def _state(result: ResultReader, body: str, level: int) -> list[Array]:
    """The first ones of q, v, vd of a body (n, ...), up to the needed level; empty for ground."""
    if body == GROUND:
        return []
    return [result.part(table, _place(result, body, table)) for table in _TABLES[: level + 1]]


def _at_rest(marker: PlacedMarker, k: int) -> MarkerMotion:
    zero = np.zeros((k, 3))
    axes = np.broadcast_to(marker.R, (k, 3, 3))
    return MarkerMotion(zero + marker.position, axes, zero, zero, zero, zero)


def marker_motion(
    marker: PlacedMarker, q: Array, v: Array | None = None, vd: Array | None = None
) -> MarkerMotion:
    """Motion of a marker of a body with states q (k, 7 + m), v (k, 6 + m) and vd (k, 6 + m)."""
    A, k = rotation_matrices(q[:, 3:7]), len(q)
    eta = q[:, 7:]
    Phi, bend = np.zeros((6, eta.shape[1])), marker.bend
    if marker.Phi_t is not None and marker.Phi_r is not None:
        Phi = np.vstack([marker.Phi_t, marker.Phi_r])
    slope = None if bend is None else np.einsum("dij,kj->kdi", bend, eta)  # K_d eta
    moved = eta @ Phi.T if slope is None else _moved(Phi - 0.5 * slope, eta)
    theta = moved[:, 3:]
    E = _rotation_matrices(theta) if theta.any() else np.broadcast_to(np.eye(3), (k, 3, 3))
    arm = E @ marker.arm
    s = marker.rho + arm + moved[:, :3]
    position, axes = q[:, :3] + _to_global(A, s), A @ E @ marker.R
    if v is None:
        return MarkerMotion(position, axes)
    omega, rate = v[:, 3:6], v[:, 6:]
    moved = rate @ Phi.T if slope is None else _moved(Phi - slope, rate)
    theta_rate = moved[:, 3:]
    e = _rotation_rate(theta, theta_rate)
    u = np.cross(e, arm) + moved[:, :3]
    velocity = v[:, :3] + _to_global(A, np.cross(omega, s) + u)
    angular_velocity = _to_global(A, omega + e)
    if vd is None:
        return MarkerMotion(position, axes, velocity, angular_velocity)
    alpha, second = vd[:, 3:6], vd[:, 6:]
    moved = second @ Phi.T
    if bend is not None and slope is not None:
        moved = _moved(Phi - slope, second) - np.einsum("dij,ki,kj->kd", bend, rate, rate)
    f = _rotation_rate(theta, moved[:, 3:]) + _rotation_rate_change(theta, theta_rate)
    a = np.cross(alpha, s) + np.cross(omega, np.cross(omega, s) + 2.0 * u)
    a = a + np.cross(f, arm) + np.cross(e, np.cross(e, arm)) + moved[:, :3]
    return MarkerMotion(
        position, axes, velocity, angular_velocity,
        vd[:, :3] + _to_global(A, a), _to_global(A, alpha + f + np.cross(omega, e)),
    )  # fmt: skip


def _moved(Phi: Array, eta: Array) -> Array:
    """(k, 6) Phi (k, 6, m) times eta (k, m)."""
    return np.asarray(np.einsum("kdi,ki->kd", Phi, eta))


def _to_global(A: Array, x: Array) -> Array:
    return np.asarray(np.einsum("kij,kj->ki", A, x))


def _rotation_matrices(theta: Array) -> Array:
    """Rotation matrices (k, 3, 3): exp of the rotation vectors (k, 3)."""
    from scipy.spatial.transform import Rotation  # importing takes 0.2 s

    return np.asarray(Rotation.from_rotvec(theta).as_matrix())


def _coefficients(square: Array) -> tuple[Array, ...]:
    """(1 - cos x)/x^2, (x - sin x)/x^3 and their derivatives with respect to x^2, for x^2 (k,
    1)."""
    small = square < _SERIES
    y = np.where(small, 1.0, square)
    x = np.sqrt(y)
    c0, c1 = (1.0 - np.cos(x)) / y, (x - np.sin(x)) / (x * y)
    d0 = (0.5 * np.sin(x) / x - c0) / y
    d1 = 0.5 * (c0 - 3.0 * c1) / y
    z = np.where(small, square, 0.0)
    series = (
        (1 / 2, -1 / 24, 1 / 720, -1 / 40320, 1 / 3628800, -1 / 479001600),
        (1 / 6, -1 / 120, 1 / 5040, -1 / 362880, 1 / 39916800, -1 / 6227020800),
        (-1 / 24, 2 / 720, -3 / 40320, 4 / 3628800, -5 / 479001600, 6 / 87178291200),
        (-1 / 120, 2 / 5040, -3 / 362880, 4 / 39916800, -5 / 6227020800, 6 / 1307674368000),
    )
    sums = (sum(c * z**n for n, c in enumerate(terms)) for terms in series)
    return tuple(
        np.where(small, near, far) for near, far in zip(sums, (c0, c1, d0, d1), strict=True)
    )


def _rotation_rate(theta: Array, rate: Array) -> Array:
    """Angular velocity of exp(theta) at a given rate of theta, in the axes before the rotation."""
    if not theta.any():
        return rate
    c0, c1, _, _ = _coefficients((theta * theta).sum(axis=1, keepdims=True))
    y = np.cross(theta, rate)
    return rate + c0 * y + c1 * np.cross(theta, y)


def _rotation_rate_change(theta: Array, rate: Array) -> Array:
    """Time derivative of `_rotation_rate` at a constant rate, due to the change of theta."""
    if not rate.any():
        return np.zeros_like(rate)
    _, c1, d0, d1 = _coefficients((theta * theta).sum(axis=1, keepdims=True))
    y = np.cross(theta, rate)
    slope = 2.0 * (theta * rate).sum(axis=1, keepdims=True)
    return np.asarray(slope * (d0 * y + d1 * np.cross(theta, y)) + c1 * np.cross(rate, y))


def _joint_coordinate(kind: str, b: int, I: MarkerMotion, J: MarkerMotion) -> Any:  # noqa: E741
    """Angle of axis b of J about z of I from x of I, stroke along z of I, or the rate of either."""
    x, y, z = (I.axes[:, :, a] for a in range(3))
    away = J.position - I.position
    if kind == "stroke":
        return _dot(z, away)
    u, v = _dot(x, J.axes[:, :, b]), _dot(y, J.axes[:, :, b])
    if kind in ("angle", "second_angle"):
        return np.arctan2(v, u)
    assert I.velocity is not None and J.velocity is not None
    assert I.angular_velocity is not None and J.angular_velocity is not None
    if kind == "stroke_rate":
        return _dot(z, J.velocity - I.velocity) + _dot(np.cross(I.angular_velocity, z), away)
    relative = np.cross(J.angular_velocity - I.angular_velocity, J.axes[:, :, b])
    return (u * _dot(y, relative) - v * _dot(x, relative)) / (u * u + v * v)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ki,ki->k", a, b))


class MarkerHistory(ResultReader):
    """Channels of a run that are recovered from its states; see `Result`."""

    @cached_property
    def scene_model(self) -> Model:
        """The model of the scene; flexible bodies are read from their files, so that no mesh is
        needed. ``[part]``, which needs one, is left out with its known answers.

        Raises
        ------
        FlexmbError
            A file of a flexible body is missing or damaged.
        """
        scene = reduced_scene(self.model, self.flexbodies)
        return Model.from_scene_dict(scene, self.path.parent)

    @property
    def _loaded_bodies(self) -> dict[str, FlexBody]:
        return {name: self.flexbody(name) for name in self.flexbodies}

    @cached_property
    def _motions(self) -> dict[str, MotionChannel]:
        """Channels that are recovered, by name."""
        model, bodies = self.scene_model, self._loaded_bodies
        with reading(self.path):  # its columns may be those of another scene
            return {channel.name: channel for channel in motion_channels(self, model, bodies)}

    def _motion_channel(self, name: str) -> MotionChannel | None:
        return self._motions.get(name) if is_recoverable(name) else None

    def _motion_values(self, channel: MotionChannel) -> Array:
        return motion_values(self, self.scene_model, self._loaded_bodies, channel)
