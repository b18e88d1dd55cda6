"""Messages for a failure status of compiled code: one sentence with place and cure."""

from __future__ import annotations

import numpy as np

from flexmb.engine.compile import Compiled
from flexmb.engine.method import (
    CURVE_END,
    NO_CONVERGENCE,
    NO_LOOP_CONVERGENCE,
    NO_PARTITION,
    NOT_FINITE,
    SELF_LOCKING,
    STEP_TOO_SMALL,
    ZERO_LENGTH,
)
from flexmb.engine.state import Work

_WHAT = {
    NO_CONVERGENCE: "Newton's method does not converge",
    NOT_FINITE: "the solution is no longer finite",
    STEP_TOO_SMALL: "the step size fell below its minimum: the requested accuracy cannot be "
    "reached",
    ZERO_LENGTH: "a spring-damper (or a stop on a distance) has no length, so its direction is "
    "undefined",
    NO_LOOP_CONVERGENCE: "the algebraic loop between forces and accelerations or reactions does "
    "not converge",
    SELF_LOCKING: "the iteration between joint friction and joint reactions does not converge",
    NO_PARTITION: "no choice of independent coordinates determines the dependent ones",
}

_LOCKS = (
    "friction grows as fast as the forces against it, so that a joint locks itself: lower its "
    "coefficients or make its bearing longer"
)

_CURE = {
    NO_CONVERGENCE: "smaller steps were tried; check the named place for a locked or singular pose",
    NOT_FINITE: "smaller steps were tried; check functions of time, and force characteristics, at "
    "this moment",
    STEP_TOO_SMALL: "ask for less accuracy",
    ZERO_LENGTH: "keep its two markers apart, or use a joint",
    NO_LOOP_CONVERGENCE: "the loop amplifies; lower its gain, or let a state or a filter stand "
    "between",
    SELF_LOCKING: _LOCKS,
    NO_PARTITION: 'the pose is singular; method = "explicit-rk" or "radau" may pass it',
}

_JUMP = {
    NO_CONVERGENCE: ", or a jump in a force or driver",
    STEP_TOO_SMALL: ", or smooth a jump in a force or driver at this time",
}

_WITHOUT_PLACE = (ZERO_LENGTH, SELF_LOCKING, NO_PARTITION)


def status_message(
    status: int, compiled: Compiled, work: Work, time: float, cause: str = ""
) -> str:
    """The message for a failed step.

    Parameters
    ----------
    status : int
        Code of the kernel, not `SUCCESS`.
    compiled, work : Compiled, Work
        The system and its scratch as the failed step left it.
    time : float
        Time at which the step began [s].
    cause : str
        The cause if it is known; it replaces the general cure.
    """
    if status == CURVE_END:
        return _curve_end(compiled, work, time)
    where = "" if status in _WITHOUT_PLACE else f"; most at {worst_place(compiled, work)}"
    if cause:
        return f"at t = {time:.6g} s {_WHAT[status]}{where}: {cause}"
    cure = _CURE[status]
    if compiled.functions or compiled.elements:
        cure += _JUMP.get(status, "")
    if status == NO_CONVERGENCE and "joint_frictions" in compiled.system.kinds:
        cure += f"; or {_LOCKS}"
    return f"at t = {time:.6g} s {_WHAT[status]}{where}: {cure}"


def _curve_end(compiled: Compiled, work: Work, time: float) -> str:
    """Message that names the joint that leaves its curve, and the end of the curve."""
    parts = compiled.system.parts
    names = compiled.layout.coordinates
    for marker in parts.curve_markers:
        s = work.trial.q[parts.coordinates[marker["coordinate"]]["iq"]]
        length = parts.pool[marker["at"] + marker["n"]]
        if not marker["closed"] and not 0.0 <= s <= length:
            joint = names[marker["coordinate"]].rpartition(".")[0]
            end = "beginning" if s < 0.0 else "end"
            return (
                f"at t = {time:.6g} s {joint} leaves its curve at the {end} of it: lengthen the "
                "curve there, set closed = true if it is a closed curve, or limit the motion to it"
            )
    return f"at t = {time:.6g} s a joint leaves its curve at an end"


def worst_place(compiled: Compiled, work: Work) -> str:
    """Name of the constraint row or the body with the largest remaining correction."""
    system, layout = compiled.system, compiled.layout
    size = np.abs(work.factor.sol[system.kkt.place[: layout.nv]]) * system.weights
    size = np.where(np.isfinite(size), size, np.inf)
    name = layout.bodies[0].name
    for body in layout.bodies:
        if body.iv <= int(np.argmax(size)) < body.iv + 6 + body.m:
            name = body.name
    if layout.nc and np.all(np.isfinite(work.con.C)):
        gap = np.abs(work.con.C)
        if gap.max() > 1e-6 * compiled.length:
            return f"{layout.rows[int(np.argmax(gap))]} and body {name}"
    return f"body {name}"
