"""What a run cost and how good it is, in words and numbers.

In: the statistics of a run, whichever it has. Out: rows for tables, and one sentence. What is not
known is left out; what has no words here is shown under its own name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from flexmb.units import SI, UnitSystem

__all__ = ["costs", "number", "sentence", "work"]

Number = float | int | str
Row = tuple[str, str, str]

_SECONDS = "seconds_"  # statistics of this prefix are wall times by phase
_PER_STEP = {"newton_iterations": "Newton iterations", "factorisations": "factorisations"}
_LARGEST, _PROJECTED = "the largest of any constraint", "before the velocities' projection"
_NOT_PROJECTED = "baumgarte"  # the method whose velocities stay as they are
_MEASURED, _WORST = "measured_error_of_", "worst_of_"
_QUANTITIES = ("positions", "velocities", "reactions")
_ERRORS = {
    "estimated_error": ("estimated error", "sum of the local errors over the motion; not verified"),
    "energy_balance_error": ("energy balance error", "over the energy that moved"),
    "largest_position_drift": ("position drift", f"m or rad, {_LARGEST}"),
    "largest_velocity_drift": ("velocity drift", f"m/s or rad/s, {_PROJECTED}"),
}
_TOLD = ("steps", "rejected_steps", "failed_steps", "step_s", "smallest_step_s", "largest_step_s")
_SCOUTED = ("method", "reason_of_method", "passes", "scout_steps", "accuracy_asked")
_OF_POINTS = ("points", "increments", "halved_increments", "singular_poses_passed")
_TEN_TIMES = "ten_times_more_accuracy_costs"
_RESUMED = "resumed_at_s"
_PIVOTS = "replaced_pivots"
_NOT_UNIQUE = "reactions_not_unique"


def work(known: Mapping[str, Number], units: UnitSystem = SI) -> list[Row]:
    """Rows on steps, iterations and errors: what, how many, and what that means."""
    rows: list[Row] = []
    if "steps" in known:
        rows.append(("steps", number(known["steps"]), "; ".join(_about_steps(known, units))))
    of = "step" if "steps" in known else "point"
    if "points" in known:
        rows.append(("points", number(known["points"]), "; ".join(_about_points(known))))
    for key, name in _PER_STEP.items():
        if key in known:
            share = float(known[key]) / max(float(known.get(f"{of}s", 0)), 1.0)
            rows.append((name, number(known[key]), f"{share:.3g} per {of}"))
    if known.get(_PIVOTS):
        meaning = "long steps, or inertia is missing somewhere"
        rows.append(("replaced pivots", number(known[_PIVOTS]), meaning))
    rows += _measured(known)
    for key, (name, meaning) in _ERRORS.items():
        if key in known:
            as_is = "points" in known or known.get("method") == _NOT_PROJECTED
            told = meaning.replace(_PROJECTED, _LARGEST) if as_is else meaning
            rows.append((name, f"{float(known[key]):.2g}", told))
    if _RESUMED in known:
        rows.append(
            ("resumed at", f"{float(known[_RESUMED]):.6g} s", "wall times count from there")
        )
    spoken = {
        *_TOLD, *_OF_POINTS, *_SCOUTED,
        *(prefix + what for prefix in (_MEASURED, _WORST) for what in _QUANTITIES),
        *_PER_STEP, *_ERRORS, _PIVOTS, _RESUMED, _TEN_TIMES, _NOT_UNIQUE,
    }  # fmt: skip
    rows += [
        (key.replace("_", " "), number(value), "")
        for key, value in known.items()
        if key not in spoken and not key.startswith(_SECONDS)
    ]
    return rows


def _measured(known: Mapping[str, Number]) -> Iterator[Row]:
    """Rows on the errors that a scout has measured."""
    for what in _QUANTITIES:
        key = f"{_MEASURED}{what}"
        if key in known:
            asked = ""
            if what == "positions" and "accuracy_asked" in known:
                asked = f"; {float(known['accuracy_asked']):.1g} asked"
            worst = known.get(f"{_WORST}{what}", "")
            meaning = f"measured, over the peak-to-peak: {worst}{asked}"
            yield f"error of {what}", f"{float(known[key]):.2g}", meaning


def costs(known: Mapping[str, Number]) -> list[Row]:
    """Rows on wall time: phase, seconds, and what a step costs."""
    rows = []
    for key, value in known.items():
        if key.startswith(_SECONDS):
            phase = key.removeprefix(_SECONDS)
            rows.append((phase.replace("_", " "), f"{float(value):.3g}", _per_step(known, phase)))
    return rows


def sentence(known: Mapping[str, Number]) -> str:
    """The run in one line; empty if nothing is known of it."""
    what, phase = ("steps", "integrate") if "steps" in known else ("points", "kinematics")
    if what not in known:
        return ""
    text = f"{number(known[what])} {what}"
    if f"{_SECONDS}{phase}" in known and _RESUMED not in known:
        text += f" in {float(known[f'{_SECONDS}{phase}']):.3g} s"
    errors = [
        f"{name} {float(known[key]):.1g}"
        for key, name in (
            ("measured_error_of_positions", "measured error"),
            ("estimated_error", "estimated error"),
            ("energy_balance_error", "energy balance"),
            ("largest_position_drift", "drift"),
        )
        if key in known
    ]
    if errors:
        text += f": {', '.join(errors)}"
    if _TEN_TIMES in known:
        factor = float(known[_TEN_TIMES])
        text += f"; ten times more accuracy would cost about {factor:.2g} times the time"
    return text


def number(value: Number) -> str:
    """A number as tables show it: thousands apart, six digits."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"{value:_}".replace("_", " ") if isinstance(value, int) else str(value)


def _about_steps(known: Mapping[str, Number], units: UnitSystem) -> Iterator[str]:
    if "step_s" in known:
        yield f"of {units.say(float(known['step_s']), 's')}"
    if "smallest_step_s" in known and "largest_step_s" in known:
        least = units.outward(float(known["smallest_step_s"]), "s")
        yield f"of {least:.3g} to {units.say(float(known['largest_step_s']), 's', 3)}"
    if "method" in known:
        reason = f" ({known['reason_of_method']})" if "reason_of_method" in known else ""
        yield f"by {known['method']}{reason}"
    if "scout_steps" in known:
        passes = int(known.get("passes", 1))
        again = f" in the last of {passes} passes" if passes > 1 else ""
        yield f"{number(known['scout_steps'])} of its scout{again}"
    if "rejected_steps" in known:
        yield f"{number(known['rejected_steps'])} rejected"
    if known.get("failed_steps"):
        yield f"{number(known['failed_steps'])} failed and tried shorter"


def _about_points(known: Mapping[str, Number]) -> Iterator[str]:
    more = int(known.get("increments", 0)) - int(known["points"])
    if more > 0:
        yield f"{number(more)} more between them"
    if known.get("halved_increments"):
        yield f"{number(known['halved_increments'])} increments failed and were halved"


def _per_step(known: Mapping[str, Number], phase: str) -> str:
    of = {"integrate": "steps", "kinematics": "points"}.get(phase, "")
    if _RESUMED in known or not known.get(of):
        return ""
    microseconds = 1e6 * float(known[f"{_SECONDS}{phase}"]) / float(known[of])
    return f"{microseconds:.3g} µs per {of.removesuffix('s')}"
