"""What a run says of the accuracy that it reached: vibrations that it lacks, causes of a miss."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexmb.analysis.dynamics.passes import (
    DIFFERENT_MOTION,
    MAX_PASSES,
    STAGNATION_RATIO,
    PreparedDynamics,
    is_stagnant,
)
from flexmb.engine.entries import NONSTIFF_METHOD
from flexmb.model.forces.friction import JointFrictionSpec

# Measured error over the requested one from which on a note reports it; what can be asked for, over
# it (at the floor of round-off two runs of 1 µm about 1 km have errors of 0.26 to 1.8 times each
# other).
_MISSED, _FLOOR = 1.0, 4.0
# Times that round-off is larger in the end than any walk, from which on the motion is said to
# multiply errors; share of an error from which on its cause is named.
_MULTIPLIES, _MAINLY = 100.0, 0.5
_LOOSEST = 0.1  # accuracy that a note advises
_LACKING = 0.05  # of the range of reactions: vibrations to note


def damped_vibration(prepared: PreparedDynamics) -> str:
    """A sentence on vibrations that the steps damp, where reactions lack much of them, or ""."""
    if prepared.verified is None:
        return ""
    name, share, begin = prepared.verified.error.vibrations.of_reactions()
    if share <= _LACKING:
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
    if part > _LACKING:
        friction = f"; {frictions[joint]} has it in its load, and what friction makes of it is in "
        friction += "no stated error"
    return (
        f"{name} lacks {size} the range of its reactions: {when} excite a vibration that the "
        f"steps of {prepared.method} damp{friction}; "
        f'method = "{NONSTIFF_METHOD}" follows it, {cures}'
    )


def reason_of_pass(prepared: PreparedDynamics) -> str:
    """A sentence where a run is repeated for a vibration that its steps damped, or ""."""
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
    """Words on what excites a vibration that begins at a time [s], and on what excites less."""
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
    """A sentence where the requested accuracy was not reached."""
    verified, accuracy = prepared.verified, prepared.settings.accuracy
    if verified is None:
        return
    worst = verified.errors().get("positions")
    if worst is None or worst.error <= _MISSED * accuracy:
        return
    unit = prepared.model.units
    reached = (
        f"accuracy {accuracy:g} was asked for and {worst.error:.2g} reached (sensor {worst.name}, "
        f"t = {unit.say(worst.time, 's', 4)})"
    )
    other = "" if prepared.method == NONSTIFF_METHOD else (
        f', or method = "{NONSTIFF_METHOD}", whose floor is lower where the scene is not stiff'
    )  # fmt: skip
    least = _FLOOR * worst.error
    ask = f"ask for accuracy = {least:.1g}" if least < _LOOSEST else "run it for a shorter time"
    apart, last = verified.difference, prepared.passes[0]["last_difference"]
    count, until = verified.fine.state.count[0], verified.error.reached_until(accuracy)
    agree = f"{reached}; the run and its comparison run agree to it until "
    agree += f"t = {unit.say(until, 's', 4)}" if np.isfinite(until) else "the end"
    kinks = count["events"] > 0 and verified.error.growth() < _MULTIPLIES  # moved steps pass others
    multiplies = (
        not kinks and verified.error.round_off_amplification(int(count["steps"])) > _MULTIPLIES
    )
    if multiplies and worst.round_off > _MAINLY * worst.error:
        yield (
            f"{agree}: shorter steps do not help, as the motion multiplies errors, and this is "
            f"what it makes of round-off; {ask}{other}"
        )
    elif is_stagnant(prepared) and apart < DIFFERENT_MOTION:
        why = "shorter steps do not help, so that this is the floor that round-off leaves method "
        why += prepared.method
        if multiplies:
            reached, why = agree, "shorter steps hardly help, as the motion multiplies errors"
        elif count["events"]:
            why, other = (
                f"shorter steps do not help, as {count['events']} events of contacts, stops, "
                "friction or functions leave errors that fall slower than the order says, and "
                "that may be several times as large"
            ), ""  # fmt: skip
        yield f"{reached}: {why}; {ask}{other}"
    elif 0.0 < apart < STAGNATION_RATIO * last:
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
