"""Motions that joints and drivers leave free or over-constrain: sentences that name a cure.

In: a pose of a kinematic analysis. Out: which coordinates are free, which drivers contradict each
other or a locked mechanism, which rows cause a singular pose and which coordinate to drive there
instead. They follow from the singular value decomposition of the weighted Jacobian: a left null
vector is a set of dependent rows, a right null vector a free motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmb.analysis.assembly.jacobian import (
    MAX_COORDINATES,
    ConstraintRows,
    Decomposition,
    DenseJacobian,
    WeightedJacobian,
    one_blas_thread,
)
from flexmb.analysis.failure_messages import not_finite_function
from flexmb.engine import method
from flexmb.engine.allocation import new_run
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import analyse_kinematics
from flexmb.engine.kinematics_loop import EVALUATE
from flexmb.engine.kinematics_point import KinematicsSettings, Path
from flexmb.engine.method import Method
from flexmb.engine.method_selection import STIFF_METHOD
from flexmb.engine.state import State, Work
from flexmb.engine.status_messages import status_message, worst_place
from flexmb.engine.tables import System
from flexmb.flexbody.arrays import Array
from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.model import Model
from flexmb.model.reading import GROUND, split_reference

_OWN_SENTENCE = (
    method.ZERO_LENGTH,
    method.CURVE_END,
    method.NO_LOOP_CONVERGENCE,
    method.SELF_LOCKING,
)
_ROUND_OFF, _NEARLY_REDUNDANT = 1e-13, 1e-3  # singular values over the largest
_NEARLY_SINGULAR = 0.02  # least singular value over the next one near a singular pose
_SINGULAR_DROP = 0.2  # singular value over that of the first pose near a singular pose
_CONTRADICTED = 1e-6  # share of the prescribed motion that contradicts other rows
_RATE_ROUND_OFF = 1e-6  # rate of a joint coordinate over the largest one that is round-off
_MOVING_BODY = 0.1  # least motion of a body that is named, for a motion of size one
_JOINT_SHARE = 0.2  # least entry of a joint that is named, over the largest of a null vector
_DRIVER_SHARE = 0.05  # the same for drivers
_MAX_SHOWN = 4
_GROUND_PREFERENCE = 2.0  # weight of coordinates of joints with ground, where actuators usually are


def call_kinematics(system: System, state: State, work: Work, path: Path, what: int) -> float:
    """Call the compiled analysis without rows of output (`compiled_calls.analyse_kinematics`)."""
    settings = KinematicsSettings(0.0, 1.0, 0, 0.0, 0)
    return analyse_kinematics(new_run(system, state, work), path, settings, what)


def singular_pose_sentence(
    compiled: Compiled, q: Array, q_first: Array, integrator: Method | None = None
) -> str:
    """The sentence on a run that ends at positions where equations are nearly redundant, or "".

    Equations that are redundant at the first positions as well are ignored. If the run was not by
    radau, it names that method.
    """
    if not np.isfinite(q).all():  # the motion has diverged
        return ""
    if compiled.layout.nv > MAX_COORDINATES or not compiled.layout.nc:
        return ""
    with one_blas_thread():
        rows = ConstraintRows(compiled)
        here, begin = (rows.evaluate(x).jacobian.decomposition for x in (q, q_first))
    share, first = (rows.S / rows.S[0] for rows in (here, begin))
    n = np.count_nonzero(first > _ROUND_OFF)
    limit = np.maximum(_NEARLY_REDUNDANT, np.minimum(_NEARLY_SINGULAR, _SINGULAR_DROP * first[:n]))
    near = share[:n][share[:n] < limit]
    if not len(near):
        return ""
    least = here.U[:, n - 1]
    drivers = _drivers_of(compiled, least)
    if drivers:
        cure = "change what is driven so that the pose is not reached, or drive another coordinate"
        return f"the mechanism reaches {_pose_of_rows(compiled, least, drivers)}: {cure}"
    what = "constraint equations are" if len(near) > 1 else "constraint equation is"
    is_radau = integrator is None or (
        integrator.stages == 0 and integrator.order >= method.HIGH_ORDER
    )
    other = "" if is_radau else f'; method = "{STIFF_METHOD}" gets through many singular poses'
    return (
        f"{len(near)} {what} nearly redundant there (to {near.min():.1g}): either the pose is "
        "nearly singular, or axes or places that should fit are slightly off; make them exact"
        + other
    )


@dataclass(frozen=True)
class KinematicPose:
    """A model at a state of a kinematic analysis."""

    compiled: Compiled
    model: Model
    state: State
    work: Work
    path: Path

    @property
    def time(self) -> float:
        """Time of the state [s]."""
        return float(self.state.t[0])

    def evaluate(self, time: float, q: Array, v: Array) -> Work:
        """Evaluate the model at another time, position and velocity; the state does not change."""
        other = self.state._replace(
            t=np.array([time]), q=q.copy(), v=v.copy(), angles=self.state.angles.copy()
        )
        call_kinematics(self.compiled.system, other, self.work, self.path, EVALUATE)
        return self.work

    def jacobian(self, q: Array | None = None) -> WeightedJacobian:
        """The Jacobian of undeformed bodies at the pose, or at other positions."""
        work = self.evaluate(self.time, self.state.q if q is None else q, self.state.v)
        Cq = DenseJacobian(self.compiled).of(work)
        return WeightedJacobian.of(self.compiled, Cq).without_modes()

    def joint_rates(self, motions: Array) -> dict[str, Array]:
        """Rates (n,) of the joint coordinates without driver in motions (nv, n), by name.

        Angles in radians, strokes over the size of the model; doubled for joints with ground.
        """
        layout, system = self.compiled.layout, self.compiled.system
        first_rows = dict(zip(layout.reactions, system.groups["row"], strict=True))
        driven = {
            (driver.joint, motion.coordinate)
            for driver in self.model.drivers.values()
            for motion in driver.motions(self.model.plane)
        }
        rates: dict[str, list[float]] = {}
        for v in motions.T:
            markers = self.evaluate(self.time, self.state.q, v).now.marker
            for joint, spec in self.model.joints.items():
                row = system.rows[first_rows[f"joints.{joint}"]]
                grounded = any(split_reference(end)[0] == GROUND for end in spec.between)
                for coordinate in JOINT_TYPES[spec.type].coordinates:
                    if (joint, coordinate) not in driven:
                        rate = self._joint_rate(markers[row["I"]], markers[row["J"]], coordinate)
                        rate *= _GROUND_PREFERENCE if grounded else 1.0
                        rates.setdefault(f"joints.{joint}.{coordinate}", []).append(rate)
        return {name: np.array(values) for name, values in rates.items()}

    def _joint_rate(self, mi: np.void, mj: np.void, coordinate: str) -> float:
        if coordinate != "stroke":
            axis = mi["R"][:, 2] if coordinate == "angle" else mj["R"][:, 2]
            return float((mj["om"] - mi["om"]) @ axis)
        axis = mi["R"][:, 0 if self.model.plane is not None else 2]
        return float(axis @ (mj["vx"] - mi["vx"])) / self.compiled.length  # J is on the axis of I

    def text(self, time: float) -> str:
        """A time in the scene's units."""
        return self.model.units.say(time, "s")


def _main_rows(compiled: Compiled, vector: Array) -> list[str]:
    """Names of the rows with the largest entries of a vector (nc,), largest first."""
    size = np.abs(vector)
    order = [k for k in np.argsort(-size) if size[k] > _JOINT_SHARE * size.max()]
    return [compiled.layout.rows[k] for k in order[:_MAX_SHOWN]]


def _owners(names: Sequence[str]) -> list[str]:
    """Joints and drivers of rows, each once."""
    return list(dict.fromkeys(name.split(":")[0] for name in names))


def _drivers_of(compiled: Compiled, vector: Array) -> list[str]:
    """Scene paths of the drivers with significant entries of a vector (nc,)."""
    size, rows = np.abs(vector), compiled.layout.rows
    which = [k for k in range(len(rows)) if size[k] > _DRIVER_SHARE * size.max()]
    return _owners([rows[k] for k in which if rows[k].startswith("drivers.")])


def free_motion_sentence(pose: KinematicPose, analysis: str = "a kinematic analysis") -> str:
    """The sentence on a pose with free motions, which an analysis needs to be driven."""
    jacobian = pose.jacobian()
    free = jacobian.velocities(jacobian.decomposition.free)
    count, n = free.shape[1], jacobian.A.shape[1]
    coordinates = _independent(pose.joint_rates(free))
    head = f"joints and drivers leave {count} motion{'s' if count > 1 else ''} free at t = 0"
    if len(coordinates) == count:
        cure = f"add a driver of {' and one of '.join(coordinates)}"
    else:
        moving = [*coordinates, *_moving_bodies(pose, free)]
        cure = f"most moves {', '.join(moving[:_MAX_SHOWN])}: add joints or drivers there"
    if pose.model.drivers and n <= pose.compiled.layout.nc:
        cure += "; if the drivers should be enough, the pose is singular: begin at another one"
    return f"{head}, and {analysis} needs all of them driven: {cure}"


def _independent(rates: dict[str, Array]) -> list[str]:
    """Coordinates that together fix the largest number of motions, those that move most first."""
    if not rates:
        return []
    names, left, selected = list(rates), np.array(list(rates.values())), list[str]()
    most = np.abs(left).max()
    for _ in range(left.shape[1]):
        size = np.linalg.norm(left, axis=1)
        if not size.max() > _RATE_ROUND_OFF * most:
            break
        k = int(np.argmax(size))
        selected.append(names[k])
        row = left[k] / size[k]
        left -= np.outer(left @ row, row)
    return selected


def _moving_bodies(pose: KinematicPose, free: Array) -> list[str]:
    """Bodies that move in free motions (nv, k), largest motion first."""
    motions = free * pose.compiled.system.weights[:, None]
    sizes = {
        f"bodies.{body.name}": float(np.linalg.norm(motions[body.iv : body.iv + 6]))
        for body in pose.compiled.layout.bodies
    }
    moving = [name for name, size in sizes.items() if size > _MOVING_BODY]
    return sorted(moving, key=lambda name: -sizes[name])


def kinematics_failure_sentence(
    status: int, pose: KinematicPose, settings: KinematicsSettings
) -> str:
    """The sentence on an analysis that ended early with this status."""
    time, interval = pose.time, settings.interval
    later = min(time + interval, interval * settings.outputs)
    times = (time, float(pose.work.trial.t[0]), later)
    cause = not_finite_function(pose.model, [t for t in times if np.isfinite(t)])
    if cause:
        return cause
    if status in _OWN_SENTENCE:
        return status_message(status, pose.compiled, pose.work, time)
    if status == method.FUNCTION_JUMP:
        return _jump(pose, time, float(pose.work.trial.t[0]))
    place = worst_place(pose.compiled, pose.work)
    if pose.compiled.layout.nv <= MAX_COORDINATES:
        jacobian = pose.jacobian()
        cause = _contradiction(pose, jacobian.decomposition, time, later)
        cause = cause or _singular_pose(pose, jacobian, time)
        if cause:
            return cause
    if status == method.BRANCH_CHANGE:
        return _branch(pose, time)
    return (
        f"at t = {pose.text(time)} the positions cannot be followed any further; most at {place}: "
        "check that the drivers ask for what the links can reach"
    )


def _jump(pose: KinematicPose, before: float, after: float) -> str:
    """The sentence on a driver whose function jumps."""
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
        f"at t = {pose.text(after)} {where} jumps, and no motion can follow: replace the jump by a "
        'step of finite duration ("step" functions)'
    )


def _contradiction(pose: KinematicPose, rows: Decomposition, time: float, later: float) -> str:
    """The sentence on drivers of motions that other rows prevent, or ""."""
    weights, at_rest = pose.compiled.system.row_weights, np.zeros_like(pose.state.v)
    rates = pose.evaluate(time, pose.state.q, at_rest).con.rate * weights
    gaps = pose.evaluate(later, pose.state.q, at_rest).con.C * weights
    for values in (rates, gaps):
        apart = rows.unreachable(values)
        if np.linalg.norm(apart) > _CONTRADICTED * np.linalg.norm(values):
            drivers = _drivers_of(pose.compiled, apart)
            others = _owners(_main_rows(pose.compiled, apart))
            return _contradicting_drivers(pose, time, drivers, others)
    return ""


def _contradicting_drivers(
    pose: KinematicPose, time: float, drivers: list[str], owners: list[str]
) -> str:
    at = f"at t = {pose.text(time)}"
    if len(drivers) > 1:
        return (
            f"{at} {' and '.join(drivers)} ask for motions that contradict each other: they drive "
            "coordinates that depend on each other; leave one of them out"
        )
    joints = [name for name in owners if name not in drivers]
    by = (
        f"{', '.join(joints)} {'does' if len(joints) == 1 else 'do'}" if joints else "the joints do"
    )
    who = drivers[0] if drivers else "a driver"
    return (
        f"{at} {who} asks for a motion that {by} not allow: the mechanism is locked; leave the "
        "driver out, or replace a joint by one that leaves more free"
    )


def _singular_pose(pose: KinematicPose, jacobian: WeightedJacobian, time: float) -> str:
    """The sentence on a singular or nearly singular pose, or ""."""
    n, U, S = jacobian.A.shape[1], jacobian.decomposition.U, jacobian.decomposition.S
    if n < 2 or len(S) < n or S[n - 1] > _NEARLY_SINGULAR * S[n - 2]:
        return ""
    drivers = _drivers_of(pose.compiled, U[:, n - 1])
    reached = _pose_of_rows(pose.compiled, U[:, n - 1], drivers)
    text = f"at t = {pose.text(time)} the mechanism reaches {reached}"
    motion = jacobian.velocities(jacobian.decomposition.V[:, n - 1 : n])
    coordinates = _independent(pose.joint_rates(motion))
    if coordinates:
        instead = f", instead of {drivers[0]}" if drivers else ""
        text += f": drive {coordinates[0]}, which moves most there{instead}"
    cure = "change what is driven so that the pose is not reached"
    return f"{text}, or {cure}" if coordinates else f"{text}: {cure}"


def _pose_of_rows(compiled: Compiled, vector: Array, drivers: list[str]) -> str:
    """Text on a singular pose by its dependent rows, a vector (nc,)."""
    joints = [name for name in _main_rows(compiled, vector) if not name.startswith("drivers.")]
    text = "a singular pose (a dead point, or the limit of its reach)"
    text += f" held by {', '.join(joints)}" if joints else ""
    return text + (f", beyond which {' and '.join(drivers)} cannot lead it" if drivers else "")


def _branch(pose: KinematicPose, time: float) -> str:
    """The sentence on a point that is on another branch of the motion."""
    after = float(pose.work.trial.t[0])
    jump = np.abs(pose.work.trial.v - pose.state.v) * pose.compiled.system.weights
    bodies = pose.compiled.layout.bodies
    most = max(bodies, key=lambda body: float(jump[body.iv : body.iv + 6].max()))
    return (
        f"the mechanism has changed its branch between t = {time:.9g} s and t = {after:.9g} s, "
        f"most at body {most.name}: begin near the branch that is meant (assembly.guess), or "
        "drive the coordinate that moves most there"
    )


def holders(pose: KinematicPose, q: Array | None = None) -> str:
    """ " held by " and the joints and drivers that hold a singular pose, here or at positions q."""
    if pose.compiled.layout.nv > MAX_COORDINATES:
        return ""
    jacobian = pose.jacobian(q)
    vector = jacobian.decomposition.U[:, jacobian.A.shape[1] - 1]
    return f" held by {', '.join(_owners(_main_rows(pose.compiled, vector)))}"


def singular_pose_notes(pose: KinematicPose) -> list[str]:
    """A note on each singular pose that the motion passed smoothly."""
    path, notes = pose.path, []
    count = int(path.count[0]["singular_poses"])
    for k in range(min(count, len(path.singular_times))):
        before, after = path.singular_times[k]
        where = holders(pose, path.singular_positions[k])
        notes.append(
            f"between t = {pose.text(before)} and {pose.text(after)} the motion passed a singular "
            f"pose{where}, where it could continue in two ways; it was continued smoothly"
        )
    if count > len(notes):
        notes.append(f"{count - len(notes)} more singular poses were passed later")
    return notes
