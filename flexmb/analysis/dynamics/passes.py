"""Whether a run that controls its error is made again: more accurately, or by another method.

In: a run that was marched. Out: the next tolerance, and what to say of the error that is left.
"""

from __future__ import annotations

from collections.abc import Iterator

from flexmb.analysis.dynamics.prepared import MOST_PASSES, Prepared
from flexmb.analysis.dynamics.run import Run
from flexmb.engine.integrators import AUTO, FINE_METHOD, STIFF_METHOD

__all__ = [
    "error_statistics", "limited_by_stability", "may_change_method", "missed_accuracy",
    "stricter_tolerance", "unstable_step",
]  # fmt: skip

# Measured error, known to a factor of about three, over what was asked for: that is good enough;
# that the next pass aims at; from which on a sentence tells it.
_ENOUGH, _AIM, _TOLD = 0.6, 0.25, 1.0
# Times as many steps at most from pass to pass; what is left of the difference of the two runs
# after a pass that was in vain, which after this many means that they part whatever the steps.
_MOST_STEPS, _IN_VAIN, _PATIENT = 5.0, 0.5, 2
_FINEST = 1e-13  # local tolerance, above round-off
_APART = 0.01  # difference of two runs from which on they are different motions
# Steps from which on, and their share at the limit of stability from which on a run is stiff.
_MANY, _OFTEN = 200, 0.35
# Their share in a run of fixed steps that fails by that.
_SELDOM = 0.01

_DRIFTED = (
    "stabilization makes forces of the drift of joints that are beyond measure: the pose is "
    "singular, or the gains are large for the steps; method = "
    '"explicit-rk" has neither drift nor gains'
)


def stricter_tolerance(prepared: Prepared) -> float | None:
    """The local tolerance that leaves what was asked for, where the measured error is larger."""
    verified, settings = prepared.verified, prepared.settings
    if verified is None or prepared.pace[1] >= MOST_PASSES:
        return None
    worst = verified.errors().get("positions")
    if worst is None or worst.error <= _ENOUGH * settings.accuracy:
        return None
    if _is_in_vain(prepared):
        return None
    chosen, share = verified.kept.method, _AIM * settings.accuracy / worst.error
    factor = share ** (chosen.error_order / verified.order)
    stricter = settings.tolerance * max(factor, _MOST_STEPS**-chosen.error_order)
    return max(float(stricter), _FINEST)


def _is_in_vain(prepared: Prepared) -> bool:
    """Whether shorter steps do not help: the finest are taken, or the last pass brought little."""
    verified = prepared.verified
    assert verified is not None
    before, passes = prepared.pace[4], prepared.pace[1]
    if prepared.settings.tolerance <= 2.0 * _FINEST:
        return True
    return bool(passes > _PATIENT and verified.difference > _IN_VAIN * before)


def error_statistics(prepared: Prepared) -> dict[str, float | int | str]:
    """Measured errors, each with what it is the error of; nothing for a run without scout."""
    verified = prepared.verified
    if verified is None:
        return {}
    statistics: dict[str, float | int | str] = {
        "accuracy_asked": verified.kept.settings.accuracy,
        "passes": int(prepared.pace[1]),
        "scout_steps": int(verified.scout.state.count[0]["steps"]),
    }
    for quantity, found in verified.errors().items():
        if quantity in ("positions", "velocities", "reactions"):
            statistics[f"measured_error_of_{quantity}"] = found.error
            statistics[f"worst_of_{quantity}"] = f"{found.name} at t = {found.time:.4g} s"
    return statistics


def missed_accuracy(prepared: Prepared) -> Iterator[str]:
    """A sentence where the accuracy asked for was not reached."""
    verified, accuracy = prepared.verified, prepared.settings.accuracy
    if verified is None:
        return
    worst = verified.errors().get("positions")
    if worst is None or worst.error <= _TOLD * accuracy:
        return
    until = verified.error.reached_until(accuracy)
    unit = prepared.model.units
    reached = (
        f"accuracy {accuracy:g} was asked for and {worst.error:.2g} reached (sensor {worst.name}, "
        f"t = {unit.say(worst.time, 's', 4)})"
    )
    if verified.difference < _APART and _is_in_vain(prepared):
        other = "" if prepared.method == FINE_METHOD else (
            f', or method = "{FINE_METHOD}", whose floor is lower where the scene is not stiff'
        )  # fmt: skip
        yield (
            f"{reached}: shorter steps do not help, so that this is the floor that round-off "
            f"leaves method {prepared.method}; ask for accuracy = {2.0 * worst.error:.1g}{other}"
        )
        return
    yield (
        f"{reached}; the run and its scout agree to it until "
        f"t = {unit.say(until, 's', 4)}: a chaotic motion multiplies errors whatever the steps, so "
        "that the rest is one motion of many; else another method or fixed steps may reach it"
    )


def may_change_method(prepared: Prepared) -> bool:
    """Whether the run may go over to the method for stiff motions."""
    spec = prepared.model.dynamics
    automatic = spec is not None and spec.method == AUTO and prepared.settings.step == 0.0
    return automatic and prepared.method != STIFF_METHOD


def unstable_step(run: Run, name: str, failed: bool) -> str:
    """The sentence for steps that an explicit method is not stable with, or nothing."""
    memory, steps, h = run.state.memory[0], run.state.count[0]["steps"], run.settings.step
    share = _SELDOM if failed else _OFTEN
    if h == 0.0 or memory["steps_at_stability_limit"] <= share * steps:
        return _DRIFTED if failed and run.method.stabilised else ""
    where = "beyond" if failed else "at"
    limit = f"the limit of stability of {name}"
    if memory["fastest_rate"] > 0.0:
        longest = run.method.coefficients[0].stable / float(memory["fastest_rate"])
        limit += f", about {longest:.1g} s at the fastest rate of this motion"
    rest = "" if failed else ", and the fastest vibrations may be wrong"
    return (
        f"the step of {h:.3g} s is {where} {limit}{rest}: shorten it, or use method = "
        f'"{STIFF_METHOD}"'
    )


def limited_by_stability(prepared: Prepared) -> bool:
    """Whether stability, not accuracy, limits the steps of an explicit method."""
    run = prepared.run if prepared.verified is None else prepared.verified.scout
    count, stiff = run.state.count[0], run.state.memory[0]["steps_at_stability_limit"]
    tried = count["steps"] + count["rejected"]
    return may_change_method(prepared) and tried > _MANY and bool(stiff > _OFTEN * tried)
