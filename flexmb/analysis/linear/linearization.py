"""The equations of motion linearised about a state: M ÿ + D ẏ + K y = f, modes, frequencies.

In: a compiled model and a consistent state of it, at rest or moving, with any joints and drivers.
Out: a `Linearization` with the matrices of all coordinates and of the independent ones, modes with
damping and whirl, and whether the state is steady. Over a parameter: a `ModeSweep`, whose modes are
matched by shape (modal assurance criterion, Allemang, Sound and Vibration 37 (2003) no. 8) and by
the distance of their eigenvalues.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from flexmb.analysis.assembly.initial_state import StartValues, assemble
from flexmb.analysis.assembly.jacobian import ConstraintRows, column_scales, one_blas_thread
from flexmb.analysis.assembly.mechanism_modes import condensation
from flexmb.analysis.linear.observer import (
    MinimalEquations,
    RowsAlongMotion,
    carrier_of,
    fastest_rate,
    observers,
)
from flexmb.analysis.linear.state_eigenmodes import Complex, Eigenmodes, Whirl, eigenmodes, whirl
from flexmb.analysis.linear.state_equations import StateEquations, Tangents
from flexmb.analysis.linear.state_space import (
    StateSpace,
    actuators,
    frequency_response,
    state_space,
)
from flexmb.engine.bodies.static_modes import static_bodies
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.errors import Problem, SceneError, nearest
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.model.model import Model

_MIN_RATE = 1e-12  # 1/s, rate of change of a state below which it is at rest
_STEADY_CHANGE = 1e-3  # relative change of coefficients per radian below which a state is steady
# Rate of accelerations at rest, over the slowest vibration, that is round-off of loads in balance.
_ROUND_OFF_RATE = 1e-6
_COMPARED_ANGLE = 0.01  # rad of the motion, or of the slowest mode, between the two states compared

_GROWTH_ROUND_OFF = 1e-6  # Re λ/|λ| above which a mode grows
_MAX_NAMED = 6  # modes named in a sentence
_MAX_MATCHED = 40  # modes followed over a sweep
_NUMBER = re.compile(r"(?<![\w.])-?\d[\d.e+-]*(, | |$)")  # not those of names


@dataclass(frozen=True)
class Linearization:
    """A model linearised about a state; all in SI.

    Attributes
    ----------
    M, D, K : (nv, nv) arrays
        Derivatives of F = M v̇ + … + Cqᵀ λ − Q with the accelerations, velocities and positions of
        all coordinates, as `Result.v` has them; rotations in body axes.
    Cq : (nc, nv) array
        Jacobian of the joints and drivers.
    basis : (nv, n) array
        Motion of all coordinates per unit of the independent ones.
    mass, damping, stiffness : (n, n) arrays
        M, D, K of the independent coordinates: M ÿ + D ẏ + K y = basisᵀ f.
    coordinates : tuple of str
        Names of the independent coordinates.
    time : float
        Time of the state [s].
    frame : str
        The observer of the modes: "ground", or a body in whose rotating axes they are written.
    whirl : Whirl or None
        Forward and backward whirl, if the motion is written in rotating axes and its modes are
        those that the ground sees; else None.
    unsteadiness : float
        Relative change of the coefficients per radian of the motion or of the slowest mode; 0:
        steady.
    notes : tuple of str
        Sentences for the user.
    """

    compiled: Compiled
    model: Model
    state: State
    tangents: Tangents
    seen: MinimalEquations
    unsteadiness: float
    notes: tuple[str, ...]
    from_ground: bool = False

    @property
    def M(self) -> Array:
        return self.tangents.M

    @property
    def D(self) -> Array:
        return self.tangents.D

    @property
    def K(self) -> Array:
        return self.tangents.K

    @property
    def Cq(self) -> Array:
        return self.tangents.Cq

    @property
    def time(self) -> float:
        return float(self.state.t[0])

    @property
    def frame(self) -> str:
        return "ground" if self.from_ground else self.seen.observer.name

    @property
    def basis(self) -> Array:
        return np.asarray(self.seen.change.S @ self.seen.coordinates.N)

    @property
    def coordinates(self) -> tuple[str, ...]:
        return self.seen.names

    @property
    def mass(self) -> Array:
        return self.seen.mass

    @property
    def damping(self) -> Array:
        return self.seen.damping

    @property
    def stiffness(self) -> Array:
        return self.seen.stiffness

    @property
    def turn(self) -> float:
        """Angular velocity of the axes in which the motion is written [rad/s]."""
        return float(np.linalg.norm(self.seen.observer.w))

    @cached_property
    def whirl(self) -> Whirl | None:
        is_turned = self.from_ground and self.turn > 0.0
        return whirl(self.seen, self._own_modes) if is_turned else None

    @property
    def _modes(self) -> Eigenmodes:
        return self._own_modes if self.whirl is None else self.whirl.modes

    @cached_property
    def _own_modes(self) -> Eigenmodes:
        """Modes of the matrices, in the axes of the observer."""
        M, D, K, coordinates = self.mass, self.damping, self.stiffness, self.seen.coordinates
        rate, states = fastest_rate(self.compiled, self.state), coordinates.states
        if not static_bodies(self.compiled.system)[0]:
            return eigenmodes(M, D, K, states, rate)
        scales = column_scales(self.compiled)[coordinates.index]
        scales = np.where(scales > 0.0, scales, 1.0)
        both = np.outer(scales, scales)
        T, L, remaining = condensation(both * M, both * K)
        M, D, K = (L.T @ (both * one) @ T for one in (M, D, K))
        modes = eigenmodes(M, D, K, states[remaining], rate)
        return Eigenmodes(modes.values, scales[:, None] * (T @ modes.shapes))

    @property
    def eigenvalues(self) -> Complex:
        """(k,) λ [1/s], one of each complex pair, in order of size."""
        return self._modes.values

    @property
    def frequencies(self) -> Array:
        """(k,) frequencies of the damped vibrations |Im λ|/2π [Hz]; 0 without vibration."""
        return np.abs(self.eigenvalues.imag) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> Array:
        """(k,) −Re λ/|λ|: 1 without vibration, negative for growing modes, 0 for rigid motions."""
        size = np.abs(self.eigenvalues)
        return np.where(
            size > 0.0, 0.0 - self.eigenvalues.real / np.where(size > 0.0, size, 1.0), 0.0
        )

    @cached_property
    def shapes(self) -> Complex:
        """(nv, k) motion of all coordinates in each mode; its largest weighted component is 1."""
        motion = self.basis @ self._modes.shapes
        weights = np.where(
            np.isfinite(self.compiled.system.weights), self.compiled.system.weights, 0
        )
        weighted = motion * weights[:, None]
        if not weighted.size:
            return motion
        largest = weighted[np.abs(weighted).argmax(axis=0), np.arange(weighted.shape[1])]
        return motion / np.where(largest == 0.0, 1.0, largest)

    @cached_property
    def energy_shares(self) -> dict[str, Array]:
        """Share of each body in the kinetic energy of each mode, (k,) by name."""
        whole = np.abs(np.einsum("ik,ij,jk->k", self.shapes.conj(), self.M, self.shapes))
        shares = {}
        for body in self.compiled.layout.bodies:
            own = slice(body.iv, body.iv + 6 + body.m)
            part = self.shapes[own]
            energy = np.abs(np.einsum("ik,ij,jk->k", part.conj(), self.M[own, own], part))
            shares[body.name] = energy / np.where(whole > 0.0, whole, 1.0)
        return shares

    def displaced(self, k: int, amplitude: float, phase: float = 0.0) -> Array:
        """Global positions (nq,) displaced by mode k (counted from 0) at a phase [rad].

        `amplitude` is that of the largest coordinate, over the model size or in radians.
        """
        motion = amplitude * np.real(self.shapes[:, k] * np.exp(1j * phase))
        q = ConstraintRows(self.compiled).move(self.state.q, motion)
        (q,) = self.compiled.layout.of_frames(q)
        return q

    @property
    def stable(self) -> bool:
        """Whether no mode grows; rigid motions do not count."""
        return not np.any(self.eigenvalues.real > _GROWTH_ROUND_OFF * np.abs(self.eigenvalues))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Actuators: components of forces and torques, line forces, springs, drivers."""
        return actuators(self.seen).names

    def state_space(
        self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> StateSpace:
        """A, B, C, D from actuators to channels; see `flexmb.analysis.linear.state_space`."""
        return state_space(self.seen, inputs, outputs)

    def frequency_response(self, input: str, output: str, frequencies: ArrayLike) -> Complex:
        """Response (k,) of a channel to a unit of an actuator, at frequencies [Hz]; 0: static."""
        modes, hertz = (lambda: self._own_modes.values), np.asarray(frequencies, float)
        return frequency_response(self.seen, input, output, hertz, modes)

    def __repr__(self) -> str:
        return f"<Linearization of {len(self.coordinates)} coordinates at t = {self.time:g} s>"


@one_blas_thread()
def linearize_state(
    compiled: Compiled, model: Model, state: State, *, frame: str = "auto"
) -> Linearization:
    """Linearise a compiled model about a consistent state.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    state : State
        With accelerations and multipliers.
    frame : str
        The axes in which the motion is written: those of "ground", of a body, or with "auto" those
        in which the coefficients change least. If all independent modal coordinates are of bodies
        that rotate alike, "ground" gives the modes as the ground sees them.

    Raises
    ------
    SceneError
        No body of that name.
    """
    state = copy.deepcopy(state)
    names = ("auto", "ground", *(body.name for body in compiled.layout.bodies))
    if frame not in names:
        raise SceneError.from_problems(
            [Problem("frame", f'unknown "{frame}"', names, nearest(frame, names))]
        )
    equations = StateEquations(compiled, state)
    tangents = equations.tangents()
    rate = fastest_rate(compiled, state)
    rate = rate if rate > _MIN_RATE else 0.0
    along = RowsAlongMotion(compiled, state)
    is_open = frame in ("auto", "ground")
    here = [MinimalEquations(along, tangents, "ground" if is_open else frame)]
    carrier = carrier_of(here[0], rate) if is_open else ""
    if (carrier or frame == "auto") and here[0].depends_on_observer:
        others = observers(compiled, state, rate)[1:]
        here += [MinimalEquations(along, tangents, name) for name in others if name != carrier]
    if carrier:  # it is preferred to others that are equally steady
        here.insert(0, MinimalEquations(along, tangents, carrier))
    change, best = 0.0, here[0]
    if rate > 0.0 and not state.v.any():
        hertz = Linearization(compiled, model, state, tangents, best, 0.0, ()).frequencies
        slowest = 2.0 * np.pi * hertz[hertz > 0.0].min(initial=np.inf)
        rate = rate if rate > _ROUND_OFF_RATE * slowest or np.isinf(slowest) else 0.0
    if rate > 0.0:
        fastest = max(rate, here[0].slowest)
        dt = min(_COMPARED_ANGLE / fastest, _longest_time(compiled, state))
        angle = fastest * dt
        begin = StartValues(
            equations.moved(state.q, dt * state.v + 0.5 * dt * dt * state.vd),
            state.v + dt * state.vd,
            float(state.t[0]) + dt,
        )
        later = assemble(compiled, model, begin=begin).state
        then = StateEquations(compiled, later).tangents()
        after = RowsAlongMotion(compiled, later)
        changes = [
            one.difference(
                MinimalEquations(after, then, one.observer.name, one.coordinates.partition), fastest
            )
            / angle
            for one in here
        ]
        changes = [change if change > _STEADY_CHANGE else 0.0 for change in changes]
        change, best = min(zip(changes, here, strict=True), key=lambda pair: pair[0])
    notes = tuple(_notes(change, best, bool(np.abs(state.v).max(initial=0.0) > 0.0)))
    made = Linearization(
        compiled, model, state, tangents, best, change, notes, frame == "ground" and carrier != ""
    )
    if made.whirl is not None and made.whirl.mixed:
        several = ", ".join(map(str, made.whirl.mixed[:_MAX_NAMED]))
        left = len(made.whirl.mixed) - _MAX_NAMED
        several += f" and {left} more" if left > 0 else ""
        note = f"seen from ground modes {several} have more than one frequency each, the one of "
        note += "the largest motion is shown: what turns is not of revolution about its axis"
        made = replace(made, notes=(*notes, note))
    return made


def _longest_time(compiled: Compiled, state: State) -> float:
    """Time [s] in which accelerations, of modes too, move nothing far."""
    size = np.abs(state.vd * compiled.system.weights)
    return float(np.sqrt(2.0 * _COMPARED_ANGLE / size[np.isfinite(size)].max(initial=1e-300)))


def _notes(change: float, seen: MinimalEquations, is_moving: bool) -> Iterator[str]:
    if change > 0.0:
        much = f"by {100 * change:.2g} %" if change < 1.0 else "altogether"
        yield (
            f"the state is not steady: seen from {seen.observer.name} its coefficients change "
            f"{much} per radian; the modes are those of this instant"
            + ("" if is_moving else '; nothing moves yet: about = "static" takes the equilibrium')
        )


@dataclass(frozen=True)
class ModeSweep:
    """Modes for a series of values of a parameter.

    Attributes
    ----------
    parameter : str
        Its name.
    values : (n,) array
        Its values, in the scene's units.
    eigenvalues : (n, k) array
        λ [1/s] of the modes, each in its own column; NaN where a value has fewer modes.
    speeds : (n,) array
        Fastest rotation of a body [rad/s], for the lines of its multiples in a Campbell diagram.
    linearizations : tuple of Linearization
        One for each value.
    """

    parameter: str
    values: Array
    eigenvalues: Complex
    speeds: Array
    linearizations: tuple[Linearization, ...]

    @classmethod
    def of(
        cls, parameter: str, values: Sequence[float], made: Sequence[Linearization]
    ) -> ModeSweep:
        """Match the modes from value to value."""
        k = min(_MAX_MATCHED, max(len(one.eigenvalues) for one in made))
        eigenvalues = np.full((len(made), k), complex(np.nan, np.nan))
        order: IntArray = np.arange(min(k, len(made[0].eigenvalues)))
        eigenvalues[0, : len(order)] = made[0].eigenvalues[order]
        columns = order.copy()
        for i, (before, one) in enumerate(zip(made, made[1:], strict=False), start=1):
            last, order = _match(before, order, one, k)
            columns = columns[last]
            eigenvalues[i, columns] = one.eigenvalues[order]
        speeds = np.array([_fastest_turn(one) for one in made])
        return cls(parameter, np.array(values, float), eigenvalues, speeds, tuple(made))

    @property
    def frames(self) -> tuple[str, ...]:
        """The observers of the modes; if nothing rotates, the ground."""
        turned = dict.fromkeys(one.frame for one in self.linearizations if one.turn)
        return tuple(turned) or ("ground",)

    @property
    def frequencies(self) -> Array:
        """(n, k) damped frequencies [Hz]."""
        return np.abs(self.eigenvalues.imag) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> Array:
        """(n, k) −Re λ/|λ|."""
        size = np.abs(self.eigenvalues)
        return np.where(size > 0.0, -self.eigenvalues.real / np.where(size > 0.0, size, 1.0), 0.0)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the user, each once, of its numbers the first, with their value."""
        seen: dict[str, str] = {}
        for value, one in zip(self.values, self.linearizations, strict=True):
            for note in one.notes:
                seen.setdefault(_NUMBER.sub("", note), f"{self.parameter} = {value:g}: {note}")
        return tuple(seen.values())


def _match(
    before: Linearization, order: IntArray, after: Linearization, most: int
) -> tuple[IntArray, IntArray]:
    """Places in `order`, numbers of modes of `before`, that modes of `after` continue; their
    numbers."""
    n = min(most, len(after.eigenvalues))
    old, new = before.eigenvalues[order], after.eigenvalues[:n]
    gap = np.abs(old[:, None] - new[None, :])
    gap /= (
        np.maximum(np.abs(old)[:, None], np.abs(new)[None, :]) + 1e-12 * np.abs(new).max() + 1e-300
    )
    if before.shapes.shape[0] == after.shapes.shape[0]:
        weights = np.sqrt(np.abs(np.diag(after.M)))[:, None]
        a, b = weights * before.shapes[:, order], weights * after.shapes[:, :n]
        norms = np.outer((np.abs(a) ** 2).sum(axis=0), (np.abs(b) ** 2).sum(axis=0))
        gap = gap + 1.0 - np.abs(a.conj().T @ b) ** 2 / np.where(norms > 0.0, norms, 1.0)
    from scipy.optimize import linear_sum_assignment  # takes 0.2 s

    rows, columns = linear_sum_assignment(gap)  # rows ascend
    return rows, columns


def _fastest_turn(of: Linearization) -> float:
    v = of.state.v
    turns = [np.linalg.norm(v[b.iv + 3 : b.iv + 6]) for b in of.compiled.layout.bodies]
    return float(max(turns))
