"""Equilibria of a model: the nearest stable one, all that are found, preloads of springs.

In: a compiled model. Out: equilibria with their channels, energies and small vibrations.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexmb.analysis.assembly.initial_state import StartValues, assemble
from flexmb.analysis.assembly.jacobian import (
    ConstraintRows,
    column_scales,
    null_space,
    one_blas_thread,
)
from flexmb.analysis.assembly.positions import close_rows
from flexmb.analysis.chunked_run import ChunkRows
from flexmb.analysis.equilibrium_solver import solve_equilibrium, spin_of
from flexmb.analysis.linear.linearization import Linearization, linearize_state
from flexmb.analysis.linear.observer import MinimalEquations, RowsAlongMotion
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.analysis.linear.state_space import actuators
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.validity_monitor import ValidityMonitor
from flexmb.engine.allocation import new_run, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import statics_units
from flexmb.engine.compiled_units import call, prepare_units
from flexmb.engine.joints.constraint_groups import forces_on_joints, joint_coordinate
from flexmb.engine.state import State
from flexmb.engine.state_rows import write_equilibrium
from flexmb.errors import AssemblyError, FlexmbError, Problem, SceneError, nearest
from flexmb.flexbody.arrays import Array
from flexmb.model.forces.friction import JointFrictionSpec
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock

# Random poses: largest number of displacements, and their largest size, over the size of the model
# or in radians.
_MAX_HOPS, _HOP = 8, 0.6
MAX_TURNS = 3
"""Turns by which springs on angles are wound, at most, in poses where a search begins."""
_SAME_PLACE = 1e-5  # distance of two equilibria that are the same, as above
_SAME_ENERGY = 1e-9  # relative difference of their energies
_ENERGY_NOISE = 1e-12  # the same over that of the fastest mode at an amplitude of the model size
_AT_REST = 1e-6  # motion of a body in a neutral motion, over the largest one, that is none
_SAME_RATES = 1e-5  # difference of eigenvalues over the largest
_BODY_SHARE = 0.5  # share of kinetic energy above which a mode is one of bodies, not of controllers
_UNBALANCED = 1e-8  # largest residual force with preloads, over that without


@dataclass(frozen=True)
class Equilibrium:
    """An equilibrium of a model.

    Attributes
    ----------
    state : State
        Positions and multipliers λ; v and v̇ are zero, or those of a steady rotation. SI. Positions
        are those of the equations (see `Layout`); those of `q` are of the frames, global.
    steps : int
        Number of steps of the solver.
    """

    compiled: Compiled
    model: Model
    state: State
    steps: int

    def __repr__(self) -> str:
        return f'<Equilibrium of "{self.model.title}", reached in {self.steps} steps>'

    @property
    def q(self) -> Array:
        """Positions (nq,), global, SI: as in a result, body after body."""
        q: Array = self.compiled.layout.of_frames(self.state.q)[0]
        return q

    @property
    def energy(self) -> float:
        """Strain, gravity and spring energy [J]."""
        equations = StateEquations(self.compiled, self.state)
        equations.residual()
        return float(equations.work.energies[1:4].sum())

    def linearize(self) -> Linearization:
        """The equations of motion linearised about it; `stable` says whether it is stable."""
        frame = "auto" if spin_of(self.model).any() else "ground"
        return linearize_state(self.compiled, self.model, self.state, frame=frame)

    def channels(self, names: Sequence[str] = ()) -> Array:
        """Channels of sensors (k,), all by default, in the scene's units."""
        compiled, model = self.compiled, self.model
        available = compiled.layout.channels
        unknown = [name for name in names if name not in available]
        if unknown:
            raise SceneError.unknown_name("channel of a sensor", unknown[0], available)
        values = dict(zip(available, self._row().sensors[0], strict=True))
        units = {name: model.channel_unit(name) or "" for name in names or available}
        return np.array(
            [model.units.outward(values[n], u) if u else values[n] for n, u in units.items()]
        )

    def limits(self) -> list[Indicator]:
        """The limits of linear elasticity and of the modes that flexible bodies exceed in it."""
        monitor = ValidityMonitor(self.compiled, self.model, self.state.q, is_motion=False)
        monitor.add(self._row())
        return list(monitor.exceeded())

    def _row(self) -> OutputBlock:
        system = self.compiled.system
        prepare_units(statics_units(system))
        rows = ChunkRows(self.compiled, 1)
        rows.clear()
        work = new_work(system, len(self.state.angles))
        call(write_equilibrium, new_run(system, self.state, work, output=rows.output))
        return rows.read()

    def growth(self) -> tuple[float, bool]:
        """Largest Re λ [1/s] of its modes, and whether it is stable.

        NaN if motions without inertia do not allow to determine it.
        """
        made = self._linearized
        if made is None:
            return np.nan, True
        return float(made.eigenvalues.real.max(initial=0.0)), made.stable

    @cached_property
    def neutral_motions(self) -> int:
        """Number of motions in which nothing holds the bodies: it is one of a family of poses."""
        made = self._linearized
        if made is None:
            return 0
        moving = np.sum(list(made.energy_shares.values()), axis=0) > _BODY_SHARE
        return int(np.sum(moving & (made.eigenvalues == 0.0)))  # states have no energy

    @cached_property
    def bodies_at_rest(self) -> set[str]:
        """Bodies that are at rest in all neutral motions."""
        made, bodies = self._linearized, self.compiled.layout.bodies
        if made is None:
            return set()
        weights = self.compiled.system.weights
        motion = np.abs(made.shapes[:, made.eigenvalues == 0.0]).max(axis=1, initial=0.0) * weights
        least = _AT_REST * motion.max(initial=0.0)
        return {one.name for one in bodies if motion[one.iv : one.iv + 6].max() <= least}

    @cached_property
    def _linearized(self) -> Linearization | None:
        """The linearised equations; None if a motion has no inertia."""
        try:
            return self.linearize()
        except FlexmbError:
            return None

    def is_of_family(self, other: Equilibrium) -> bool:
        """Whether another one has the same energy and vibrations, and one of both neutral motions.

        Bodies that rest in these are in the same places. (The rate of a neutral motion of the other
        one may be just above its round-off.)
        """
        a, b = self._linearized, other._linearized
        if a is None or b is None or not max(self.neutral_motions, other.neutral_motions):
            return False
        still = self.bodies_at_rest & other.bodies_at_rest
        if separation(self.compiled, self.state.q, other.state.q, still)[0] > _SAME_PLACE:
            return False
        fastest = np.abs(a.eigenvalues).max()
        mass = sum(float(a.M[body.iv, body.iv]) for body in self.compiled.layout.bodies)
        scale = mass * (fastest * self.compiled.length) ** 2
        limit = _SAME_ENERGY * max(abs(self.energy), abs(other.energy)) + _ENERGY_NOISE * scale
        if abs(self.energy - other.energy) > limit or len(a.eigenvalues) != len(b.eigenvalues):
            return False
        parts = [np.sort([x.real, np.abs(x.imag)], axis=1) for x in (a.eigenvalues, b.eigenvalues)]
        return bool(np.abs(parts[0] - parts[1]).max() <= _SAME_RATES * fastest)


@one_blas_thread()
def find_equilibrium(
    compiled: Compiled, model: Model, *, time: float = 0.0, start: Array | None = None
) -> Equilibrium:
    """The equilibrium to which a model descends from a pose.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    time : float
        Time at which functions and drivers are evaluated [s].
    start : (nq,) array, optional
        First positions, global; by default those of the scene.

    Raises
    ------
    AssemblyError
        Joints that cannot be closed; no equilibrium, with the body that keeps moving and its force.
    """
    (q,) = (compiled.initial_q,) if start is None else compiled.layout.of_equations(start)
    begin = StartValues(q, np.zeros(compiled.layout.nv), time)
    if start is None and time == 0.0:
        first = assemble(compiled, model)
    else:
        first = assemble(compiled, model, begin=begin)
    steps = solve_equilibrium(first.compiled, model, first.state, spin=spin_of(model))
    return Equilibrium(first.compiled, model, first.state, steps)


def find_equilibria(
    compiled: Compiled, model: Model, *, time: float = 0.0, starts: int = 30, seed: int = 0
) -> list[Equilibrium]:
    """Equilibria found from many poses of the same assembly, in order of increasing energy.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    time : float
        Time at which functions and drivers are evaluated [s].
    starts : int
        Number of first poses: that of the scene, and random ones along the free motions.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    list of Equilibrium
        Different equilibria: stable ones, found by descent, and unstable ones, found by Newton's
        method. One of each family in which nothing holds the bodies; mirror images count as one.
    """
    first = find_equilibrium(compiled, model, time=time)
    equilibria = [first]
    rng, rows = np.random.default_rng(seed), ConstraintRows(compiled)
    scales = column_scales(compiled)
    has_windings = len(_windings(first)) > 0
    for k in range(starts - 1):
        winds = has_windings and k % 2 == 1
        q = _random_pose(rows, first.state.q, scales, rng, time, straight=winds)
        if q is None:
            continue
        for descend in (True, False):
            begin = StartValues(q, np.zeros(compiled.layout.nv), time)
            try:
                state = assemble(compiled, model, begin=begin).state
                steps = solve_equilibrium(
                    compiled, model, state, descend=descend, spin=spin_of(model)
                )
            except AssemblyError:
                continue
            another = Equilibrium(compiled, model, state, steps)
            if not any(_is_same(another, one) for one in equilibria):
                equilibria.append(another)
    return sorted(equilibria, key=lambda one: one.energy)


def _windings(one: Equilibrium) -> Array:
    """Angles on which springs and stops act, counted over turns [rad]."""
    names = one.compiled.layout.coordinates
    springs = one.model.forces
    angular = {
        f"forces.{name}"
        for name, spec in forces_on_joints(one.model).items()
        if joint_coordinate(one.model, spec) != "stroke"
        and not isinstance(springs[name], JointFrictionSpec)
    }
    values = one.state.q[one.compiled.layout.nq - len(names) :]
    return np.array([x for name, x in zip(names, values, strict=True) if name in angular])


def largest_winding(equilibria: Sequence[Equilibrium]) -> float:
    """Largest difference of an angle with a spring between two of them [rad]."""
    return float(np.ptp([_windings(one) for one in equilibria], axis=0).max(initial=0.0))


def _is_same(a: Equilibrium, b: Equilibrium) -> bool:
    """Whether bodies are in the same places, and springs on angles hold the same energy; or both
    are of one family.

    A turn of a wheel on which no spring acts changes nothing.
    """
    if separation(a.compiled, a.state.q, b.state.q)[0] > _SAME_PLACE:
        return a.is_of_family(b)
    if np.abs(_windings(a) - _windings(b)).max(initial=0.0) <= _SAME_PLACE:
        return True
    return abs(a.energy - b.energy) <= _SAME_ENERGY * max(abs(a.energy), abs(b.energy))


def _random_pose(
    rows: ConstraintRows,
    q: Array,
    scales: Array,
    rng: np.random.Generator,
    time: float,
    straight: bool = False,
) -> Array | None:
    """Another pose of the assembly, by displacements along its free motions.

    They are random, or `straight` on, up to some turns.
    """
    pose = close_rows(rows, q, None, time)
    towards = rng.standard_normal(len(scales)) if straight else np.zeros(0)
    far = rng.random() * 2.0 * np.pi * MAX_TURNS if straight else 0.0
    hops = round(far / _HOP) if straight else int(rng.integers(1, _MAX_HOPS))
    for _ in range(hops):
        if pose is None:
            return None
        free = np.zeros((len(scales), 0))
        jacobian = pose.jacobian
        rigid = ~jacobian.modal
        if rigid.any():
            null = null_space(jacobian.A[:, rigid]) if len(jacobian.A) else np.eye(int(rigid.sum()))
            free = np.zeros((len(scales), null.shape[1]))
            free[jacobian.columns[rigid]] = null
        if not free.shape[1]:
            return None
        along = free.T @ towards if straight else rng.standard_normal(free.shape[1])
        towards = free @ along
        step = scales * towards
        share = 1.0 if straight else rng.random()
        step *= _HOP * share / np.abs(step[scales > 0] / scales[scales > 0]).max()
        pose = close_rows(rows, rows.move(pose.q, step), None, time) or pose
    return None if pose is None else pose.q


def separation(
    compiled: Compiled, a: Array, b: Array, names: Collection[str] | None = None
) -> tuple[float, str]:
    """Distance of two positions (nq,), over the size of the model or in radians; its body.

    With `names` of these bodies only.
    """
    scales, apart = column_scales(compiled), []
    for body in compiled.layout.bodies:
        if names is not None and body.name not in names:
            continue
        size = scales[body.iv] if scales[body.iv] > 0.0 else compiled.length
        far = float(np.abs(a[body.iq : body.iq + 3] - b[body.iq : body.iq + 3]).max()) / size
        p, r = a[body.iq + 3 : body.iq + 7], b[body.iq + 3 : body.iq + 7]
        turn = 2.0 * float(np.linalg.norm(p - r if p @ r > 0.0 else p + r))  # for a small angle
        modes = slice(body.iq + 7, body.iq + 7 + body.m)
        bent = np.abs(a[modes] - b[modes])
        sizes = scales[body.iv + 6 : body.iv + 6 + body.m]
        bent = np.where(sizes > 0.0, bent / np.where(sizes > 0.0, sizes, 1.0), 0.0)
        apart.append((max(far, turn, float(bent.max(initial=0.0))), body.name))
    return max(apart, default=(0.0, ""))


def preloads(compiled: Compiled, model: Model, springs: Sequence[str]) -> dict[str, float]:
    """Additional forces [N or N m] of springs with which the pose of the scene is an equilibrium.

    If there are many solutions, the least-squares one of least norm.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    springs : sequence of str
        Springs, line forces and components of forces (``"push.x"``) that may change.

    Returns
    -------
    dict of str to float
        By name; positive forces push the markers of a spring apart.

    Raises
    ------
    SceneError
        No such force.
    AssemblyError
        No such forces balance the pose; names the body that is not balanced.
    """
    state = assemble(compiled, model).state
    state.v[:] = 0.0
    state.vd[:] = 0.0
    state.lam[:] = 0.0
    equations = StateEquations(compiled, state)
    force = equations.residual()
    seen = MinimalEquations(RowsAlongMotion(compiled, state), equations.tangents(), "ground")
    of = actuators(seen)
    unknown = [name for name in springs if name not in of.forces]
    if unknown:
        forces = tuple(of.forces)
        raise SceneError.from_problems(
            [Problem(f'"{n}"', "no such force", forces, nearest(n, forces)) for n in unknown]
        )
    basis = seen.change.S @ seen.coordinates.N
    scales = column_scales(compiled)[seen.coordinates.index]
    right = scales * (basis.T @ force)
    columns = scales[:, None] * (basis.T @ np.array([of.forces[name] for name in springs]).T)
    lengths = np.linalg.lstsq(columns, right, rcond=1e-10)[0]
    left = right - columns @ lengths
    if np.abs(left).max(initial=0.0) > _UNBALANCED * np.abs(right).max(initial=0.0):
        name = seen.names[int(np.abs(left).argmax())]
        raise AssemblyError(
            f"no preload of {', '.join(springs)} brings the pose into balance: {name} keeps "
            f"{100 * np.abs(left).max() / np.abs(right).max():.3g} % of its load; let another "
            "spring change too, or move the pose"
        )
    return dict(zip(springs, map(float, lengths), strict=True))
