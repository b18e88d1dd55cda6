"""Costs and accuracy of a run as texts: rows of tables, and one sentence.

In: the statistics of a result. Out: texts. A statistic that a run does not have is left out; one
that is not described here is shown under its name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from flexmb.units import SI, UnitSystem

NOTES = "notes"
"""The statistic with the notes of a run, one per line."""
NOT_CONTAINED = "not_contained"
"""The statistic that says which errors the stated errors of a run do not contain."""
MODE_SHAPE = "mode_shape"
"""Statistic of a file that contains a vibration mode of a linearised machine: its number."""
SECONDS = "seconds_"
"""Prefix of statistics that are wall times by phase [s]."""
_SPLIT = "`flexmb budget SCENE` splits them"
_MAX_NOTES = 8000  # characters
Number = float | int | str
Row = tuple[str, str, str]

_ITERATIONS = {
    name: name.replace("_", " ").replace("newton", "Newton")
    for name in ("newton_iterations", "residual_evaluations", "factorisations")
}
_ALL_CONSTRAINTS, _UNPROJECTED = "the largest of any constraint", "before the projection"
_DIVIDED = "half steps failed, or are those of the run, whose steps failed and were divided"
_MEASURED_BY = "of fixed steps; verify = true measures it, in three times the time"
_SUM_OF_LOCAL_ERRORS = (
    "not verified: the sum of the local errors over the motion, from which that of the result may "
    "differ by orders of magnitude; leave out verify = false to measure it"
)
_WITHOUT_PROJECTION = "baumgarte"  # the integration method that does not project velocities
_MEASURED, _WORST, _SCALE = "measured_error_of_", "worst_of_", "scale_of_"
MEASURED_QUANTITIES = ("positions", "velocities", "accelerations", "reactions")
"""Quantities of which a run tells the largest measured error."""
_ERRORS = {
    "estimated_error": ("estimated error", _SUM_OF_LOCAL_ERRORS),
    "energy_balance_error": ("energy balance error", "over the energy that moved"),
    "largest_position_drift": ("position drift", f"m or rad, {_ALL_CONSTRAINTS}"),
    "largest_velocity_drift": ("velocity drift", f"m/s or rad/s, {_UNPROJECTED}"),
}
_OF_STEPS = ("steps", "rejected_steps", "failed_steps", "step_s", "smallest_step_s",
             "largest_step_s", "method", "reason_of_method", "passes", "comparison_steps",
             "accuracy_asked")  # fmt: skip
_OF_POINTS = ("points", "increments", "halved_increments", "singular_poses_passed")
_SPEED = "largest_speed"
_TEN_TIMES = "ten_times_more_accuracy_costs"
_RESUMED = "resumed_at_s"
_PIVOTS = "replaced_pivots"
_WITH_WORDS = {
    *_OF_STEPS, *_OF_POINTS, *_ITERATIONS, *_ERRORS, _PIVOTS, _RESUMED, _TEN_TIMES, _SPEED,
    *(prefix + name for prefix in (_MEASURED, _WORST, _SCALE) for name in MEASURED_QUANTITIES),
    "reactions_not_unique", NOTES, NOT_CONTAINED, MODE_SHAPE,
}  # fmt: skip


def energy_rows(result: Any) -> list[tuple[str, ...]]:
    """Energies and works that are not always zero, and the error of their balance."""
    histories = dict(result.energy)
    # inverse dynamics computes no work
    if result.has_columns("balance") and "inverse_dynamics" not in result.seconds:
        histories["energy balance error"] = result.balance
    return [
        (name.replace("_", " "), *(f"{x:.6g}" for x in (values[-1], values.min(), values.max())))
        for name, values in histories.items()
        if values.any()
    ]


def notes_statistic(notes: Iterable[str]) -> dict[str, str]:
    """The notes of a run as a statistic for its result file; empty without notes."""
    text = "\n".join(note.replace("\n", " ") for note in notes)
    return {NOTES: text[:_MAX_NOTES]} if text else {}


def work_rows(statistics: Mapping[str, Number], units: UnitSystem = SI) -> list[Row]:
    """Rows on steps, iterations and errors: name, value, meaning."""
    rows: list[Row] = []
    of = "step" if "steps" in statistics else "point"
    if "steps" in statistics:
        meaning = "; ".join(_about_steps(statistics, units))
        rows.append(("steps", _number_text(statistics["steps"]), meaning))
    if "points" in statistics:
        meaning = "; ".join(_about_points(statistics))
        rows.append(("points", _number_text(statistics["points"]), meaning))
    for key, name in _ITERATIONS.items():
        if key in statistics:
            ratio = float(statistics[key]) / max(float(statistics.get(f"{of}s", 0)), 1.0)
            rows.append((name, _number_text(statistics[key]), f"{ratio:.3g} per {of}"))
    if statistics.get(_PIVOTS):
        meaning = "regularised: inertia is missing somewhere, or the pose is singular"
        rows.append(("ill-conditioned pivots", _number_text(statistics[_PIVOTS]), meaning))
    rows += _measured_errors(statistics)
    if _is_unmeasured(statistics):
        why = _DIVIDED if "comparison_steps" in statistics else _MEASURED_BY
        rows.append(("error of positions", "not measured", why))
    for key, (name, meaning) in _ERRORS.items():
        if key in statistics:
            exact = "points" in statistics or statistics.get("method") == _WITHOUT_PROJECTION
            text = meaning.replace(_UNPROJECTED, _ALL_CONSTRAINTS) if exact else meaning
            if key == "largest_velocity_drift" and _SPEED in statistics:
                text += f"; speeds up to {float(statistics[_SPEED]):.2g}"
            rows.append((name, f"{float(statistics[key]):.2g}", text))
    if NOT_CONTAINED in statistics:
        rows.append(("not included", "", f"{statistics[NOT_CONTAINED]}; {_SPLIT}"))
    if _RESUMED in statistics:
        time = f"{float(statistics[_RESUMED]):.6g} s"
        rows.append(("resumed at", time, "wall times count from there"))
    rows += [
        (key.replace("_", " "), _number_text(value), "")
        for key, value in statistics.items()
        if key not in _WITH_WORDS and not key.startswith(SECONDS)
    ]
    return rows


def _measured_errors(statistics: Mapping[str, Number]) -> Iterator[Row]:
    """Rows on the errors measured by comparison with a second run."""
    for name in MEASURED_QUANTITIES:
        key = f"{_MEASURED}{name}"
        if key in statistics:
            over = statistics.get(f"{_SCALE}{name}", "the peak-to-peak")
            meaning = f"measured, over {over}: {statistics.get(f'{_WORST}{name}', '')}"
            if name == "positions" and "accuracy_asked" in statistics:
                meaning += f"; {float(statistics['accuracy_asked']):.1g} requested"
            yield f"error of {name}", f"{float(statistics[key]):.2g}", meaning


def _is_unmeasured(statistics: Mapping[str, Number]) -> bool:
    """Whether nothing measures the error of fixed steps."""
    return "step_s" in statistics and f"{_MEASURED}positions" not in statistics


def _about_steps(statistics: Mapping[str, Number], units: UnitSystem) -> Iterator[str]:
    if "step_s" in statistics:
        yield f"of {units.say(float(statistics['step_s']), 's')}"
    if "smallest_step_s" in statistics and "largest_step_s" in statistics:
        least = units.outward(float(statistics["smallest_step_s"]), "s")
        yield f"of {least:.3g} to {units.say(float(statistics['largest_step_s']), 's', 3)}"
    if "method" in statistics:
        reason = statistics.get("reason_of_method")
        yield f"by {statistics['method']}" + (f" ({reason})" if reason is not None else "")
    if "comparison_steps" in statistics:
        passes = int(statistics.get("passes", 1))
        last = f" in the last of {passes} passes" if passes > 1 else ""
        yield f"{_number_text(statistics['comparison_steps'])} of the comparison run{last}"
    if "rejected_steps" in statistics:
        yield f"{_number_text(statistics['rejected_steps'])} rejected"
    if statistics.get("failed_steps"):
        yield f"{_number_text(statistics['failed_steps'])} failed and tried shorter"


def _about_points(statistics: Mapping[str, Number]) -> Iterator[str]:
    more = int(statistics.get("increments", 0)) - int(statistics["points"])
    if more > 0:
        yield f"{_number_text(more)} more between them"
    if statistics.get("halved_increments"):
        yield f"{_number_text(statistics['halved_increments'])} increments failed and were halved"


def time_rows(statistics: Mapping[str, Number]) -> list[Row]:
    """Rows on wall time: phase, seconds, and the time of a step or point."""
    rows = []
    for key, value in statistics.items():
        if key.startswith(SECONDS):
            phase = key.removeprefix(SECONDS)
            of = {"integrate": "steps", "kinematics": "points", "statics": "points"}.get(phase, "")
            meaning = ""
            if statistics.get(of) and _RESUMED not in statistics:
                microseconds = 1e6 * float(value) / float(statistics[of])
                meaning = f"{microseconds:.3g} µs per {of.removesuffix('s')}"
            rows.append((phase.replace("_", " "), f"{float(value):.3g}", meaning))
    return rows


def summary_sentence(statistics: Mapping[str, Number]) -> str:
    """The run in one line; empty for a run without steps and points."""
    what, phase = ("steps", "integrate") if "steps" in statistics else ("points", "kinematics")
    phase = "statics" if f"{SECONDS}statics" in statistics else phase
    if what not in statistics:
        return ""
    text = f"{_number_text(statistics[what])} {what}"
    if f"{SECONDS}{phase}" in statistics and _RESUMED not in statistics:
        text += f" in {float(statistics[f'{SECONDS}{phase}']):.3g} s"
    errors = ["error not measured"] if _is_unmeasured(statistics) else []
    errors += [
        f"{name} {float(statistics[key]):.1g}"
        for key, name in (
            ("measured_error_of_positions", "measured error"),
            ("estimated_error", "error not measured, sum of local errors"),
            ("energy_balance_error", "energy balance"),
            ("largest_position_drift", "drift"),
        )
        if key in statistics
    ]
    if errors:
        text += f": {', '.join(errors)}"
        if NOT_CONTAINED in statistics:
            text += f" (not included: {statistics[NOT_CONTAINED]})"
    if _TEN_TIMES in statistics:
        factor = float(statistics[_TEN_TIMES])
        text += f"; ten times more accuracy would cost about {factor:.2g} times the time"
    return text


def _number_text(value: Number) -> str:
    """A number as tables show it: spaces between thousands, six digits."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"{value:_}".replace("_", " ") if isinstance(value, int) else str(value)
