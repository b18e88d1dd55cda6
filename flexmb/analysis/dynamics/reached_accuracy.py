"""Notes of a run on accuracy and steps: missing vibrations, energy that is off, accuracy that is
not reached, points of curves that decide the number of steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.interpolate import CubicSpline

from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.passes import (
    DIFFERENT_MOTION,
    MAX_PASSES,
    STAGNATION_RATIO,
    PreparedDynamics,
    is_stagnant,
)
from flexmb.engine.method_selection import NONSTIFF_METHOD
from flexmb.flexbody.arrays import Array
from flexmb.model.excitation import driving_functions
from flexmb.model.forces.friction import JointFrictionSpec
from flexmb.model.functions.piecewise import Piecewise
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import ACCURACY

# Measured over requested error above which a note reports it; accuracy that a note advises, over
# the measured error (at the level of round-off two runs of 1 µm at a distance of 1 km have errors
# of 0.26 to 1.8 times each other).
_MIN_MISS, _REACHABLE_FACTOR = 1.0, 4.0
# Ratio of the round-off at the end to that of a random walk above which the motion is said to
# amplify errors; share of an error above which its cause is named.
_MIN_AMPLIFICATION, _MAIN_SHARE = 100.0, 0.5
_MAX_ADVISED = 0.1  # largest accuracy that a note advises
_FALLING = 3.0  # ratio of energy errors of a comparison run and the run, from which on they fall
_MAX_ENERGY_ERROR = 0.05  # energy error over the energy exchanged, above which a note says so
# Mean departure of quasi-static modes in a step from the path of their rates, over their mean
# deformation, above which steps are too long for them. One step in fifty that jumps has as much.
_MAX_LAG = 0.02
# Curves through points that are looked at: least number of points in the run, and of the curve
# (fewer are corners of a shape that is meant); largest number of steps for each; distance of a
# point and the end of a step that are the same, over the run.
_MIN_POINTS, _MIN_KNOTS, _MAX_STEPS, _SAME_TIME = 300, 50, 4.0, 1e-9
_MIN_MISSING_VIBRATION = 0.05  # least missing vibration of a reaction in a note, over its range


def damped_vibration(prepared: PreparedDynamics) -> str:
    """A sentence on vibrations that the steps damp and reactions lack, or ""."""
    if prepared.verified is None:
        return ""
    name, share, begin = prepared.verified.error.vibrations.of_reactions()
    if share <= _MIN_MISSING_VIBRATION:
        return ""
    when, cures = _jump(prepared, begin)
    size = f"{share:.0%} of" if share < 2.0 else f"{share:.2g} times"
    frictions = {
        f"joints.{spec.joint}": f"forces.{force}"
        for force, spec in prepared.model.forces.items()
        if isinstance(spec, JointFrictionSpec)
    }
    joint, part, _ = prepared.verified.error.vibrations.of_reactions(frictions)
    friction = ""
    if part > _MIN_MISSING_VIBRATION:
        friction = f"; {frictions[joint]} has it in its load, and what friction makes of it is in "
        friction += "no stated error"
    return (
        f"{name} lacks {size} the range of its reactions: {when} excite a vibration that the "
        f"steps of {prepared.method} damp{friction}; "
        f'method = "{NONSTIFF_METHOD}" follows it, {cures}'
    )


def reason_of_pass(prepared: PreparedDynamics) -> str:
    """A sentence if a run is repeated because its steps damped a vibration, or ""."""
    assert prepared.verified is not None
    worst = prepared.verified.errors()["positions"]
    if not worst.begin >= 0.0:
        return ""
    when, cures = _jump(prepared, worst.begin)
    return (
        f"steps follow a vibration, which sensor {worst.name} shows to {worst.error:.2g} of its "
        f"range, and which {when} excite; {cures}"
    )


def _jump(prepared: PreparedDynamics, begin: float) -> tuple[str, str]:
    """Texts: what excites a vibration that begins at a time [s]; how to excite less of it."""
    smooth = "a smooth change (step5 for step) excites less, damping lets it end"
    at = prepared.model.units.say(begin, "s", 4)
    assert prepared.verified is not None and prepared.verified.jumps is not None
    if begin not in prepared.verified.jumps.before:
        what = f"stops, contacts, friction or limits of functions at t = {at}"
        return what, "damping lets it end"
    if begin > prepared.settings.start:
        return f"loads or accelerations that jump at t = {at}", smooth
    smooth += ', start = "quasi-static" begins without what loads that are there at once excite'
    return "loads or accelerations of the start", smooth


def missed_accuracy(prepared: PreparedDynamics) -> Iterator[str]:
    """A sentence if the requested accuracy was not reached."""
    verified, accuracy = prepared.verified, prepared.settings.accuracy
    if verified is None:
        return
    worst = verified.errors().get("positions")
    if worst is None or worst.error <= _MIN_MISS * accuracy:
        return
    unit = prepared.model.units
    reached = (
        f"accuracy {accuracy:g} was asked for and {worst.error:.2g} reached (sensor {worst.name}, "
        f"t = {unit.say(worst.time, 's', 4)})"
    )
    other = "" if prepared.method == NONSTIFF_METHOD else (
        f', or method = "{NONSTIFF_METHOD}", whose floor is lower where the scene is not stiff'
    )  # fmt: skip
    least = _REACHABLE_FACTOR * worst.error
    ask = f"ask for accuracy = {least:.1g}" if least < _MAX_ADVISED else "run it for a shorter time"
    apart, last = verified.difference, prepared.passes[0]["last_difference"]
    count, until = verified.fine.state.count[0], verified.error.reached_until(accuracy)
    agree = f"{reached}; the run and its comparison run agree to it until "
    agree += f"t = {unit.say(until, 's', 4)}" if np.isfinite(until) else "the end"
    kinks = (
        count["events"] > 0 and verified.error.growth() < _MIN_AMPLIFICATION
    )  # shifted steps meet other events
    multiplies = (
        not kinks
        and verified.error.round_off_amplification(int(count["steps"])) > _MIN_AMPLIFICATION
    )
    if multiplies and worst.round_off > _MAIN_SHARE * worst.error:
        yield (
            f"{agree}: shorter steps do not help, as the motion multiplies errors, and this is "
            f"what it makes of round-off; {ask}{other}"
        )
    elif worst.of_values > _MAIN_SHARE * worst.error:
        yield (
            f"{reached}: so much is the round-off of the values of the sensor, which measures from "
            "far away; state relative_to = a marker on ground near the model"
        )
    elif is_stagnant(prepared) and apart < DIFFERENT_MOTION:
        why = "shorter steps do not help, so that this is the floor that round-off leaves method "
        why += prepared.method
        if multiplies:
            reached, why = agree, "shorter steps hardly help, as the motion multiplies errors"
        elif count["events"]:
            why, other = (
                f"shorter steps do not help, as {count['events']} events of contacts, stops, "
                "friction, functions or curves leave errors that fall slower than the order says, "
                "and that may be several times as large"
            ), ""  # fmt: skip
        yield f"{reached}: {why}; {ask}{other}"
    elif 0.0 < apart < STAGNATION_RATIO * last and not is_stagnant(prepared):
        yield (
            f"{reached}: shorter steps still help, but these were the last of {MAX_PASSES} passes; "
            f"take fixed steps, or {ask}{other}"
        )
    else:
        why = "they part there whatever the steps; another method or fixed steps may reach it"
        damps = prepared.method != NONSTIFF_METHOD and verified.jumps is not None
        if damps and verified.jumps.begins_before(until):  # type: ignore[union-attr]
            why = (
                f"steps of {prepared.method} damp a vibration that a jump of loads or "
                f'accelerations excites there, which method = "{NONSTIFF_METHOD}" follows'
            )
        elif multiplies:
            why = (
                "a chaotic motion multiplies errors whatever the steps, so that the rest is one "
                "motion of many"
            )
        yield f"{agree}: {why}"


def energy_error(prepared: PreparedDynamics, cause: str) -> str:
    """A sentence on an error of the energy balance, or ""; `cause` is one known already, or ""."""
    run, settings, bodies = prepared.run, prepared.run.settings, prepared.model.bodies
    share, step = run.rows.balance.relative, settings.step
    if (
        share <= max(_MAX_ENERGY_ERROR, 10.0 * settings.accuracy)
        or (settings.determinate == 1 and not prepared.model.drivers)  # nothing moves
    ):
        return ""
    what = f"the energy balance is off by {100 * share:.3g} % of the energy that moved: "
    if settings.static_after_step == 1:
        vibrations = 'leave out vibrations; deformation = "automatic" has them'
        memory = run.state.memory[0]
        lag = float(memory["static_lag"] / max(memory["static_size"], np.finfo(float).tiny))
        if lag <= _MAX_LAG:
            return f"{what}quasi-static modes {vibrations}"
        long, cure = "steps", "ask for more accuracy"
        if step:
            long, cure = f"steps of {prepared.model.units.say(step, 's', 3)}", "shorten them"
        return (
            f"{what}{long} are too long for quasi-static modes, which depart in a step by "
            f"{100 * lag:.3g} % of their deformation from where its rate leads; {cure}; if it "
            f"stays, they {vibrations}"
        )
    if cause:
        return f"{what}{cause}"
    if _only_works_are_off(prepared):
        return ""
    rest = "a force or an effect makes energy"
    for body in run.compiled.layout.bodies:
        coupling = getattr(bodies[body.name], "inertia_coupling", "full")
        if coupling != "full":
            rest = f"{coupling} coupling of bodies.{body.name} leaves out terms of its inertia: "
            rest += 'inertia_coupling = "full" has them'
    if step > 0.0:
        return (
            f"{what}steps of {step:.3g} s are too long for the forces of this motion, such as an "
            "impact; shorten them, or leave out dynamics.step, so that the accuracy is controlled; "
            f"if it stays, {rest}"
        )
    return f"{what}ask for more accuracy; if it stays, {rest}"


def _only_works_are_off(prepared: PreparedDynamics) -> bool:
    """Whether the energy of the motion is right, and only the sums of works are not.

    Positions and velocities are measured to be right, and the error of the balance falls with the
    steps, so that no force makes energy. What passes through a machine in a long run, from a motor
    to its load, may be thousands of times the energy that it stores; so is the error of that sum.
    """
    verified, accuracy = prepared.verified, prepared.run.settings.accuracy
    if verified is None:
        return False
    errors, own = verified.errors(), prepared.run.rows.balance.relative
    right = all(
        name in errors and errors[name].error <= most
        for name, most in (("positions", accuracy), ("velocities", _MAX_ENERGY_ERROR))
    )
    return right and verified.scout.rows.balance.relative > _FALLING * own


def steps_at_points(run: Integration, model: Model) -> Iterator[str]:
    """A sentence for each curve through points that decides the number of steps.

    Steps end where its derivatives jump. Where they do not, as at the points of a cubic spline,
    steps follow the scatter of the points, if it is larger than the accuracy.
    """
    spec, steps = model.dynamics, int(run.state.count[0]["steps"])
    if spec is None or spec.step is not None:
        return
    accuracy = ACCURACY if spec.accuracy is None else spec.accuracy
    events = run.compiled.system.time_events[:, 0]
    for _, path, function in driving_functions(model):
        curve, kind = function.curve, function.source
        if curve is None or not isinstance(kind, Mapping) or len(curve.knots) < _MIN_KNOTS:
            continue
        periods = int(spec.duration / curve.period) if curve.period > 0.0 else 1
        if periods > 1 and periods * (len(curve.knots) - 1) > 2 * steps:
            continue
        times = _times_of_points(curve, spec.duration)
        if len(times) < _MIN_POINTS or not len(times) / 2 <= steps <= _MAX_STEPS * len(times):
            continue
        near = np.searchsorted(events, times * (1.0 - _SAME_TIME))
        beside = events[np.minimum(near, len(events) - 1)] if len(events) else np.inf
        at_points = int(np.sum(np.abs(beside - times) <= _SAME_TIME * spec.duration))
        scatter = _scatter(curve)
        is_rough = scatter > accuracy
        if at_points > len(times) / 2:
            cure = "smooth the points or give fewer"
            if kind["type"] != "spline" and not is_rough:
                cure = 'they lie on a smooth curve, of which type = "spline" has no such jumps'
            yield (
                f"{path}: {at_points} of the {steps} steps end at points of its curve, since its "
                f"derivatives jump there: {cure}"
            )
        elif is_rough:
            yield (
                f"{path}: its {len(times)} points decide the number of steps, {steps}: they "
                f"scatter by {100 * scatter:.2g} % of their range; smooth them or give fewer"
            )


def _times_of_points(curve: Piecewise, end: float) -> Array:
    """Times of the points within the run [s]."""
    times = curve.knots
    if curve.period > 0.0:
        turns = np.arange(-1, int(end / curve.period) + 1)
        times = np.unique(times[None, :-1] + (turns * curve.period)[:, None])
    return times[(times > 0.0) & (times < end)]


def _scatter(curve: Piecewise) -> float:
    """Deviation of every second point from a curve through the others, over the range (rms)."""
    x, y = curve.knots, curve.coefficients[1:, 0]
    x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    deviation = CubicSpline(x[::2], y[::2])(x[1::2]) - y[1::2]
    return float(np.sqrt(np.mean(deviation[1:-1] ** 2)) / (np.ptp(y) or 1.0))
