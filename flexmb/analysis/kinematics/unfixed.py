"""Motions that joints and drivers do not fix, or fix twice, in sentences that name a cure.

In: a pose of a kinematic analysis. Out: which coordinates are free, which drivers contradict each
other or a locked mechanism, which rows hold a singular pose and what to drive there instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.dynamics.failure import not_finite_function
from flexmb.analysis.kinematics.singular import (
    LARGEST,
    Decomposition,
    JointRates,
    decompose,
    drivers_of,
    owners,
    rows_of,
)
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import EVALUATE, analyse_kinematics
from flexmb.engine.kinematics_state import KinematicsSettings, Path
from flexmb.engine.state import State, Work
from flexmb.engine.status import sentence, worst_place
from flexmb.engine.tables import System
from flexmb.engine.work import new_run
from flexmb.model.model import Model

if TYPE_CHECKING:
    from flexmb.analysis.kinematics.analysis import PreparedSweep

__all__ = ["Pose", "enter", "free_motions", "passed_poses", "sweep_reason"]

Array = NDArray[np.float64]

# What has a sentence of its own.
_SAID = (method.ZERO_LENGTH, method.CURVE_END, method.NO_LOOP, method.SELF_LOCKING)
_NEARLY = 0.02  # least singular value over the next one: a singular pose is near
_CONTRADICTED = 1e-6  # share of what is asked that no motion can follow
_MOVES = 1e-6  # of the largest rate of a joint coordinate in a motion


def enter(system: System, state: State, work: Work, path: Path, what: int) -> float:
    """A call of the compiled analysis that writes no rows; see `entries.analyse_kinematics`."""
    settings = KinematicsSettings(0.0, 1.0, 0, 0.0, 0)
    return analyse_kinematics(new_run(system, state, work), path, settings, what)


@dataclass(frozen=True)
class Pose:
    """A model at a state."""

    compiled: Compiled
    model: Model
    state: State
    work: Work
    path: Path

    def at(self, time: float, q: Array, v: Array) -> Work:
        """Everything evaluated at another time, position and velocity; the state stays."""
        other = self.state._replace(
            t=np.array([time]), q=q.copy(), v=v.copy(), angles=self.state.angles.copy()
        )
        enter(self.compiled.system, other, self.work, self.path, EVALUATE)
        return self.work

    def decomposition(self, q: Array | None = None) -> Decomposition:
        """Cq of the pose, or at other positions."""
        positions = self.state.q if q is None else q
        work = self.at(float(self.state.t[0]), positions, self.state.v)
        return decompose(self.compiled, work)

    def coordinates(self, motions: Array, q: Array | None = None) -> tuple[list[str], Array]:
        """Names (k) of the joint coordinates without driver, rates (k, n) in motions (nv, n)."""
        names: list[str] = []
        columns = []
        for motion in motions.T:
            work = self.at(float(self.state.t[0]), self.state.q if q is None else q, motion)
            found = JointRates(self.compiled, self.model, work)
            names = found.names
            columns.append(found.rates)
        return names, np.array(columns).reshape(motions.shape[1], -1).T

    def said(self, time: float) -> str:
        """A time in the scene's units."""
        return self.model.units.say(time, "s")


def free_motions(pose: Pose) -> str:
    """The sentence for a pose whose rows leave motions free."""
    found = pose.decomposition()
    count = found.n - found.rank
    names, rates = pose.coordinates(found.V[:, found.rank :])
    chosen = _independent(names, rates)
    head = f"joints and drivers leave {count} motion{'s' if count > 1 else ''} free at t = 0"
    if len(chosen) == count:
        cure = f"add a driver of {' and one of '.join(chosen)}"
    else:
        told = [*chosen, *_moving_bodies(pose, found)]
        cure = f"most moves {', '.join(told[:4])}: add joints or drivers there"
    if pose.model.drivers and found.n <= pose.compiled.layout.nc:
        cure += "; if the drivers should be enough, the pose is singular: begin at another one"
    return f"{head}, and a kinematic analysis needs all of them driven: {cure}"


def _independent(names: list[str], rates: Array) -> list[str]:
    """Coordinates that fix as many motions together as they can, those that move most first."""
    left, chosen = rates.copy(), list[str]()
    most = np.abs(rates).max(initial=0.0)
    for _ in range(rates.shape[1]):
        size = np.linalg.norm(left, axis=1) if len(names) else np.zeros(0)
        if not size.max(initial=0.0) > _MOVES * most:
            break
        k = int(np.argmax(size))
        chosen.append(names[k])
        row = left[k] / size[k]
        left -= np.outer(left @ row, row)
    return chosen


def _moving_bodies(pose: Pose, found: Decomposition) -> list[str]:
    """Bodies that take part in free motions, most first."""
    motions = found.V[:, found.rank :] * pose.compiled.system.weights[:, None]
    sizes = {
        f"bodies.{body.name}": float(np.linalg.norm(motions[body.iv : body.iv + 6]))
        for body in pose.compiled.layout.bodies
    }
    moving = [name for name, size in sizes.items() if size > 0.1]
    return sorted(moving, key=lambda name: -sizes[name])


def sweep_reason(status: int, prepared: PreparedSweep) -> str:
    """The sentence for an analysis that ended early with this status."""
    pose = Pose(prepared.compiled, prepared.model, prepared.state, prepared.work, prepared.path)
    time, interval = float(pose.state.t[0]), prepared.settings.interval
    later = min(time + interval, interval * prepared.settings.outputs)
    tried = (time, float(pose.work.trial.t[0]), later)
    told = not_finite_function(pose.model, [t for t in tried if np.isfinite(t)])
    if told:
        return told
    if status in _SAID:
        return sentence(status, pose.compiled, pose.work, time)
    if status == method.LEAP:
        return _leap(pose, time, float(pose.work.trial.t[0]))
    place = worst_place(pose.compiled, pose.work)
    if pose.compiled.layout.nv <= LARGEST:
        found = pose.decomposition()
        told = _contradiction(pose, found, time, later) or _singular(pose, found, time)
        if told:
            return told
    if status == method.JUMP:
        return _branch(pose, time)
    return (
        f"at t = {pose.said(time)} the positions cannot be followed any further; most at {place}: "
        "check that the drivers ask for what the links can reach"
    )


def _leap(pose: Pose, before: float, after: float) -> str:
    """The sentence for a driver whose function jumps."""
    jumps = {
        f"drivers.{name}.{motion.coordinate}": abs(
            motion.function.value(after)[0] - motion.function.value(before)[0]
        )
        for name, driver in pose.model.drivers.items()
        for motion in driver.motions(pose.model.plane)
        if driver.order == 0
    }
    where = max(jumps, key=jumps.__getitem__, default="a function of time")
    return (
        f"at t = {pose.said(after)} {where} jumps, and no motion can follow: replace the jump by a "
        'step of finite duration ("step" functions)'
    )


def _contradiction(pose: Pose, found: Decomposition, time: float, later: float) -> str:
    """The sentence for drivers that ask for what rows hold already; empty if it is not that."""
    weights = pose.compiled.system.row_weights
    still = np.zeros_like(pose.state.v)
    work = pose.at(time, pose.state.q, still)
    asked = [work.con.rate * weights]
    work = pose.at(later, pose.state.q, still)
    asked.append(work.con.C * weights)
    for values in asked:
        apart = found.repeated(values)
        if np.linalg.norm(apart) > _CONTRADICTED * np.linalg.norm(values):
            drivers = drivers_of(pose.compiled, apart)
            others = [name for name in owners(rows_of(pose.compiled, apart))]
            return _contradicted(pose, time, drivers, others)
    return ""


def _contradicted(pose: Pose, time: float, drivers: list[str], others: list[str]) -> str:
    at = f"at t = {pose.said(time)}"
    if len(drivers) > 1:
        return (
            f"{at} {' and '.join(drivers)} ask for motions that contradict each other: they drive "
            "coordinates that depend on each other; leave one of them out"
        )
    held = [name for name in others if name not in drivers]
    by = f"{', '.join(held)} {'does' if len(held) == 1 else 'do'}" if held else "the joints do"
    who = drivers[0] if drivers else "a driver"
    return (
        f"{at} {who} asks for a motion that {by} not allow: the mechanism is locked; leave the "
        "driver out, or replace a joint by one that leaves more free"
    )


def _singular(pose: Pose, found: Decomposition, time: float) -> str:
    """The sentence for a pose that is singular or nearly so; empty if it is not."""
    n, S = found.n, found.S
    if n < 2 or len(S) < n or S[n - 1] > _NEARLY * S[n - 2]:
        return ""
    rows = rows_of(pose.compiled, found.U[:, n - 1])
    drivers = drivers_of(pose.compiled, found.U[:, n - 1])
    names, rates = pose.coordinates(found.V[:, n - 1 : n])
    held = [name for name in rows if not name.startswith("drivers.")]
    text = f"at t = {pose.said(time)} the mechanism reaches a singular pose"
    text += f" (a dead point, or the limit of its reach) held by {', '.join(held)}"
    if drivers:
        text += f", beyond which {' and '.join(drivers)} cannot lead it"
    chosen = _independent(names, rates)
    if chosen:
        instead = f", instead of {drivers[0]}" if drivers else ""
        text += f": drive {chosen[0]}, which moves most there{instead}"
    return text + ", or change what is driven so that the pose is not reached"


def _branch(pose: Pose, time: float) -> str:
    """The sentence for a point that does not continue the motion."""
    after = float(pose.work.trial.t[0])
    jump = np.abs(pose.work.trial.v - pose.state.v) * pose.compiled.system.weights
    bodies = pose.compiled.layout.bodies
    most = max(bodies, key=lambda body: float(jump[body.iv : body.iv + 6].max()))
    return (
        f"the mechanism has changed its branch between t = {time:.9g} s and t = {after:.9g} s, "
        f"most at body {most.name}: begin near the branch that is meant (assembly.guess), or "
        "drive the coordinate that moves most there"
    )


def passed_poses(prepared: PreparedSweep) -> list[str]:
    """A note for each singular pose that the motion passed through smoothly."""
    path = prepared.path
    count = int(path.count[0]["singular_poses"])
    if not count:
        return []
    pose = Pose(prepared.compiled, prepared.model, prepared.state, prepared.work, prepared.path)
    told = []
    for k in range(min(count, len(path.singular_times))):
        before, after = path.singular_times[k]
        where = ""
        if prepared.compiled.layout.nv <= LARGEST:
            found = pose.decomposition(path.singular_positions[k])
            where = f" held by {', '.join(owners(rows_of(pose.compiled, found.U[:, found.n - 1])))}"
        told.append(
            f"between t = {pose.said(before)} and {pose.said(after)} the motion passed a singular "
            f"pose{where}, where it could go on in two ways; it was continued smoothly"
        )
    if count > len(told):
        told.append(f"{count - len(told)} more singular poses were passed later")
    return told
