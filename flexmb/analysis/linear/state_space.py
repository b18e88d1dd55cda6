"""State space and frequency response of a linearised model: from actuators to sensors.

f are forces of actuators, u coordinates that drivers prescribe. The motion x, ẋ, ẍ and ÿ are
matrices X0, X1, X2 and Y times the column (y, ẏ, u, u̇ | f, ü). A sensor c(q, v, v̇, λ) is
linearised by differences. The input of a driver is its acceleration, with its value and rate as
states, so that all transfer functions are proper. Its frequency response is that to its value; at
zero it is the limit, if there is one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import column_scales, one_blas_thread
from flexmb.analysis.linear.observer import MinimalEquations
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.engine.forces.spring_damper import DISTANCE_OF
from flexmb.errors import Problem, SceneError, nearest
from flexmb.flexbody.arrays import Array

_POSITION_STEP = 1e-3  # step of differences, over the model size or in radians
_FIRST_DERIVATIVE = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))
_AXES = "xyz"
_FAR_BELOW = 1.0 / 64.0  # of the slowest mode: there its response is a power series
_FARTHER = 1e-3  # of that: where a part that grows without bound shows
_SHRINKS = 0.6  # change of a value with half the frequency, over the one before: 1/2; a pole 2 or 4
_EQUAL_LIMITS = 1e-6  # difference of two extrapolations that are the same, over the values
_ROUND_OFF = 1e-10  # of the sum of the terms of a channel, over the terms
_ZERO_FORCE = 1e-12  # a generalised force per unit of an actuator below this counts as zero


class StateSpace(NamedTuple):
    """ż = A z + B w, c = C z + D w in SI: for scipy.signal and python-control.

    `states`, `inputs` and `outputs` are names. The input of a driver is its acceleration.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


class Actuators(NamedTuple):
    """Actuators of a model: forces by name with their columns, drivers with their rows."""

    size: int  # nv
    forces: dict[str, Array]  # (nv,) generalised force per unit
    drivers: dict[str, int]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all actuators."""
        return (*self.forces, *self.drivers)


def actuators(minimal: MinimalEquations) -> Actuators:
    """Forces, torques, line forces and springs of a model, and its drivers."""
    compiled, forces = minimal.compiled, {}
    equations = StateEquations(compiled, minimal.state)
    equations.residual()
    x, R = equations.markers["x"], equations.markers["R"]
    for path, element in compiled.elements.items():
        name, tables = path.partition(".")[2], compiled.system.kinds[element.kind]
        row = tables.rows[element.row]
        if element.kind == "loads" and not (row["factor"] == 1.0).all():  # a load of a body
            forces[name] = sum(
                equations.marker_motion(one["marker"])[3 * one["torque"] :][:3].T
                @ (R[one["axes"]] @ one["factor"])
                for one in tables.rows[element.row : element.row + element.n]
            )
        elif element.kind == "loads":
            J, other = equations.marker_motion(row["marker"]), int(row["other"])
            if other >= 0:  # the reaction acts at the same point
                back = equations.marker_motion(other)
                arm = x[row["marker"]] - x[other]
                J = J - back - np.vstack([np.cross(back[3:].T, arm).T, np.zeros_like(back[3:])])
            axes = np.eye(3) if row["axes"] < 0 else R[row["axes"]]
            part = J[3:] if row["torque"] else J[:3]
            for a in range(3):
                forces[f"{name}.{_AXES[a]}"] = part.T @ axes[:, a]
        elif element.kind == "springs" or (
            element.kind == "force_characteristics" and row["measure"] == DISTANCE_OF
        ):
            h = x[row["J"]] - x[row["I"]]
            J, back = (equations.marker_motion(row[side])[:3] for side in "JI")
            forces[name] = (J - back).T @ h / max(float(np.linalg.norm(h)), _ZERO_FORCE)
    first = compiled.layout.nv - len(compiled.layout.coordinates)
    for k, path in enumerate(compiled.layout.coordinates):
        section, _, name = path.partition(".")
        if section == "forces":  # line forces, and forces and torques on joint coordinates
            forces[name] = np.eye(compiled.layout.nv)[first + k]
    moving = compiled.system.kkt.column >= 0
    forces = {
        name: np.where(moving, column, 0.0)
        for name, column in forces.items()
        if np.abs(column[moving]).max(initial=0.0) > _ZERO_FORCE
    }
    drivers: dict[str, int] = {}
    for path, group in zip(compiled.layout.reactions, compiled.system.groups, strict=True):
        if path.startswith("drivers."):
            name, rows = (
                path.removeprefix("drivers."),
                range(group["row"], group["row"] + group["n"]),
            )
            single = len(rows) == 1
            drivers |= {name if single else f"{name}.{_AXES[k]}": r for k, r in enumerate(rows)}
    return Actuators(compiled.layout.nv, forces, drivers)


class _Rates(NamedTuple):
    """Matrices X0, X1, X2 (nv, columns) of x, ẋ, ẍ; Y of ÿ; lam of the multipliers."""

    X0: Array
    X1: Array
    X2: Array
    Y: Array
    lam: Array


@one_blas_thread()
def _motion(minimal: MinimalEquations, forces: Array, rows: Sequence[int]) -> _Rates:
    """The matrices of the motion for the column (y, ẏ, u, u̇ | f, ü)."""
    c = minimal.coordinates
    at, left, n, d, k = minimal.at, minimal.left, c.n, len(rows), forces.shape[1]
    G, Gd, Gdd = c.G[:, rows], c.Gd[:, rows], c.Gdd[:, rows]
    f = minimal.change.S.T @ forces
    b2 = left.T @ at.M @ G
    b1 = left.T @ (2.0 * at.M @ Gd + at.D @ G)
    b0 = left.T @ (at.M @ Gdd + at.D @ Gd + at.K @ G)
    right = np.hstack([-minimal.stiffness, -minimal.damping, -b0, -b1, left.T @ f, -b2])
    Y = np.asarray(np.linalg.solve(minimal.mass, right)) if n else right
    nv = len(c.N)
    none, no_f = np.zeros((nv, n)), np.zeros((nv, k))
    no_d = np.zeros((nv, d))
    X0 = np.hstack([c.N, none, G, no_d, no_f, no_d])
    X1 = np.hstack([c.Nd, c.N, Gd, G, no_f, no_d])
    X2 = np.hstack([c.Ndd, 2.0 * c.Nd, Gdd, 2.0 * Gd, no_f, G]) + c.N @ Y
    loads = np.zeros_like(X0)
    loads[:, 2 * n + 2 * d : 2 * n + 2 * d + k] = f
    rest = loads - at.M @ X2 - at.D @ X1 - at.K @ X0
    lam = np.asarray(np.linalg.lstsq(at.L, rest, rcond=1e-10)[0]) if at.L.size else rest[:0]
    return _Rates(X0, X1, X2, Y, lam)


def state_space(
    minimal: MinimalEquations,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> StateSpace:
    """State space of a linearised model.

    Parameters
    ----------
    minimal : MinimalEquations
        The linearised model.
    inputs : sequence of str, optional
        Forces (``"push.x"``), line forces and springs (``"cylinder"``: pushes its markers apart),
        drivers (``"motor"``); all by default.
    outputs : sequence of str, optional
        Channels of sensors; all by default.

    Raises
    ------
    SceneError
        No such actuator or channel.
    """
    forces, rows, names = _select(actuators(minimal), inputs)
    rates = _motion(minimal, forces, rows)
    n, d, k = minimal.coordinates.n, len(rows), forces.shape[1]
    width = 2 * n + 2 * d
    A = np.zeros((width, rates.Y.shape[1]))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n] = rates.Y
    A[2 * n : 2 * n + d, 2 * n + d : width] = np.eye(d)
    A[2 * n + d : width, width + k :] = np.eye(d)
    C, channels = _outputs(minimal, rates, outputs)
    has_value = np.concatenate([~minimal.coordinates.states, np.ones(width - n, bool)])
    drivers = names[k:]
    states = (
        *minimal.names, *(f"{name}'" for name in minimal.names),
        *drivers, *(f"{name}'" for name in drivers),
    )  # fmt: skip
    columns = np.concatenate([has_value, np.ones(k + d, bool)])
    A, C = A[has_value][:, columns], C[:, columns]
    n_states = int(has_value.sum())
    return StateSpace(
        A[:, :n_states], A[:, n_states:], C[:, :n_states], C[:, n_states:],
        tuple(name for name, one in zip(states, has_value, strict=True) if one),
        (*names[:k], *(f"{name}''" for name in drivers)), channels,
    )  # fmt: skip


def frequency_response(
    minimal: MinimalEquations,
    input: str,
    output: str,
    frequencies: Array,
    modes: Callable[[], NDArray[np.complex128]],
) -> NDArray[np.complex128]:
    """Steady response of a channel to a unit of an actuator, at each frequency.

    Parameters
    ----------
    minimal : MinimalEquations
        The linearised model.
    input, output : str
        An actuator (N, N m; of a driver m or rad) and a channel, as of `state_space`.
    frequencies : (k,) array
        In Hz; at zero the limit of a motion that is ever slower.
    modes : callable
        Gives the eigenvalues [1/s], zero for rigid motions; called for a limit.

    Returns
    -------
    (k,) complex array
        Amplitude and phase; not finite at an undamped frequency itself, and where there is no
        limit.
    """
    forces, rows, _ = _select(actuators(minimal), [input])
    rates = _motion(minimal, forces, rows)
    n, d = minimal.coordinates.n, len(rows)
    C, _ = _outputs(minimal, rates, [output])
    # the input is f, or u with u̇ = s u and ü = s² u; ÿ then follows from the rest of Y
    columns = [2 * n, 2 * n + 1, 2 * n + 2] if d else [2 * n]

    def terms(s: complex) -> NDArray[np.complex128]:
        """The terms of the channel, whose sum it is."""
        acting = np.array([1.0, s, s * s]) if d else np.array([1.0])
        right = rates.Y[:, columns] @ acting
        A = s * s * np.eye(n) - s * rates.Y[:, n : 2 * n] - rates.Y[:, :n]
        try:
            y = np.linalg.solve(A, right) if n else right
        except np.linalg.LinAlgError:
            y = np.full(n, np.nan, complex)
        return np.concatenate([C[0, : 2 * n] * np.concatenate([y, s * y]), C[0, columns] * acting])

    response = np.array([terms(2j * np.pi * float(f)).sum() for f in frequencies], complex)
    if not np.all(frequencies):
        sizes = np.abs(modes()) if n else np.zeros(0)
        response[frequencies == 0.0] = _slow_limit(terms, min(sizes[sizes > 0.0], default=1.0))
    return response


def _slow_limit(terms: Callable[[complex], NDArray[np.complex128]], slowest: float) -> float:
    """The limit of a response at zero frequency; nan if it grows without bound.

    At zero itself the equations of states that add up a rate, and of rigid motions, are singular,
    also where the channel does not show them. Far below the slowest mode the real part is even in
    the frequency; it is extrapolated (Richardson) from three frequencies, each half of the one
    before. A fourth, much lower, shows a part that grows slowly.
    """
    all_terms = [terms(1j * slowest * _FAR_BELOW * part) for part in (1.0, 0.5, 0.25, _FARTHER)]
    h0, h1, h2, low = (complex(one.sum()) for one in all_terms)
    floors = [_ROUND_OFF * float(np.abs(one).sum()) for one in all_terms]
    size = max(map(abs, (h0, h1, h2)))
    floor = max(_ROUND_OFF * size, *floors[:3])
    a, b = (4.0 * h1.real - h0.real) / 3.0, (4.0 * h2.real - h1.real) / 3.0
    limit = (16.0 * b - a) / 15.0
    if (
        abs(h2 - h1) <= max(_SHRINKS * abs(h1 - h0), floor)
        and abs(limit - b) <= _EQUAL_LIMITS * size + floor
        and abs(low - limit) <= 2.0 * _FARTHER * size + floors[3]
    ):
        return limit if abs(limit) > floor else 0.0
    return float("nan")


def _select(of: Actuators, names: Sequence[str] | None) -> tuple[Array, list[int], tuple[str, ...]]:
    """Columns of the selected forces, rows of the selected drivers, and names, forces first."""
    names = of.names if names is None else tuple(names)
    unknown = [name for name in names if name not in of.names]
    if unknown:
        what = "unknown actuator; forces are named with their component, such as push.x"
        raise SceneError.from_problems(
            [
                Problem(f'inputs "{name}"', what, of.names, nearest(name, of.names))
                for name in unknown
            ]
        )
    forces = [name for name in names if name in of.forces]
    drivers = [name for name in names if name in of.drivers]
    matrix = np.array([of.forces[name] for name in forces]).reshape(len(forces), of.size).T
    return matrix, [of.drivers[name] for name in drivers], (*forces, *drivers)


def _outputs(
    minimal: MinimalEquations, rates: _Rates, outputs: Sequence[str] | None
) -> tuple[Array, tuple[str, ...]]:
    """(channels, columns) matrix of the selected sensors, and their names."""
    channels = minimal.compiled.layout.channels
    names = channels if outputs is None else tuple(outputs)
    unknown = [name for name in names if name not in channels]
    if unknown:
        raise SceneError.from_problems(
            [
                Problem(
                    f'outputs "{name}"',
                    "unknown channel of a sensor",
                    channels,
                    nearest(name, channels),
                )
                for name in unknown
            ]
        )
    if not names:
        return np.zeros((0, rates.X0.shape[1])), ()
    change, (of_q, of_v, of_vd, of_lam) = minimal.change, _channel_slopes(minimal)
    turned = rates.X1 + change.W @ rates.X0
    motion = change.S @ (rates.X2 + change.W @ rates.X1 + change.Wd @ rates.X0) + change.P @ turned
    whole = of_q @ change.S @ rates.X0 + of_v @ change.S @ turned + of_vd @ motion
    whole += of_lam @ rates.lam
    return whole[[channels.index(name) for name in names]], names


def _channel_slopes(minimal: MinimalEquations) -> tuple[Array, Array, Array, Array]:
    """Derivatives of all channels with respect to q (k, nv), v, v̇, and λ (k, nc)."""
    compiled, equations = minimal.compiled, StateEquations(minimal.compiled, minimal.state)
    state, nv = minimal.state, compiled.layout.nv
    scales = column_scales(compiled)
    scales[[start.iv for start in compiled.starts]] = 1.0
    q, base = state.q.copy(), equations.channels()
    slopes = [np.zeros((len(base), n)) for n in (nv, nv, nv, compiled.layout.nc)]
    for k in np.flatnonzero(scales):
        h = _POSITION_STEP * scales[k]
        unit = np.arange(nv) == k
        for step, weight in _FIRST_DERIVATIVE:
            state.q[:] = equations.moved(q, step * h * unit)
            slopes[0][:, k] += weight / h * equations.channels()
        state.q[:] = q
    steps = (
        scales,
        scales,
        np.full(compiled.layout.nc, max(1.0, np.abs(state.lam).max(initial=0.0))),
    )
    for of, values, sizes in zip(slopes[1:], (state.v, state.vd, state.lam), steps, strict=True):
        for k in np.flatnonzero(sizes):
            here = float(values[k])
            for sign in (1.0, -1.0):
                values[k] = here + sign * sizes[k]
                of[:, k] += sign / (2.0 * sizes[k]) * equations.channels()
            values[k] = here
    return slopes[0], slopes[1], slopes[2], slopes[3]
