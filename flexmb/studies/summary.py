"""The sentences of a study: references, the cheapest settings that meet the target, costs."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence

import numpy as np

from flexmb.studies.rows import Row, StudyRows
from flexmb.studies.study_settings import is_numerical, label

_MIN_GAIN = 1.5  # times less error: what a slower setting must give to count as better
_MIN_SPAN = 10.0  # times less error that a series must cover before its trend is reported
_MAX_WAIT = 1.25  # wall time over processor time: above it other programs disturbed a run
_OVERHEAD = 0.05  # s: what opening and writing files may take


def seconds_text(value: float) -> str:
    """Seconds with three digits."""
    return f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def summarise(study: StudyRows) -> list[str]:
    """All sentences below the table of a study."""
    lines = []
    for group, sentence in study.references.items():
        name = _group_label(study, group)
        lines.append(f"{name}: {sentence}" if name else sentence)
    for group in study.groups():
        lines += _cheapest(study, group)
    lines += [
        f"ten times less error in {name} costs {factor:.2g} times the time"
        for name in study.compared
        if (factor := cost_of_a_digit(study, name)) is not None
    ]
    return [*lines, *_costs(study), *_failures(study)]


def _group_label(study: StudyRows, group: str) -> str:
    """The values that tell one machine from the others of the study."""
    groups = study.groups()
    values = groups[group][0].values if group in groups else {}
    every = [row.values for rows in groups.values() for row in rows]
    own = [row.values for row in groups.get(group, ())]
    telling = {
        knob: value
        for knob, value in values.items()
        if all(one[knob] == value for one in own) and any(one[knob] != value for one in every)
    }
    return label(telling) if len(groups) > 1 else ""


def _cheapest(study: StudyRows, group: str) -> Iterator[str]:
    """One sentence for each different answer."""
    target = _percent(study.target)
    name = _group_label(study, group)
    at = f" at {name}" if name else ""
    answers: dict[int, tuple[Row, list[str]]] = {}
    missed = []
    for quantity in study.compared:
        row = study.cheapest(quantity, group=group)
        if row is None:
            missed.append(quantity)
        else:
            answers.setdefault(id(row), (row, []))[1].append(quantity)
    for row, quantities in answers.values():
        errors = ", ".join(f"{q} to {_percent(row.errors[q].bound)}" for q in quantities)
        yield (
            f"cheapest setting that meets {target}{at} in {_listed(quantities)}: "
            f"{label(row.values)}, {seconds_text(row.time)} s ({errors}){_command(study, row)}"
        )
    if missed:
        yield f"no setting{at} is known to meet {target} in {_listed(missed)}"


def _listed(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def _command(study: StudyRows, row: Row) -> str:
    if not study.source:
        return ""
    changes = " ".join(
        f"--set {knob}={shlex.quote(str(value))}" for knob, value in row.values.items()
    )
    return f": flexmb run {shlex.quote(study.source)} {changes}"


def series_knob(study: StudyRows) -> str:
    """The knob along which lines are drawn: the number of the integration with most values."""

    def weight(knob: str) -> tuple[bool, int]:
        values = {str(row.values[knob]) for row in study.rows}
        numbers = all(isinstance(row.values[knob], int | float) for row in study.rows)
        return is_numerical(knob) and numbers and len(values) > 1, len(values)

    return max(study.knobs, key=weight)


def series(study: StudyRows) -> dict[str, list[Row]]:
    """The settings that differ by the knob of the series only, by the values of the others."""
    along = series_knob(study)
    members: dict[str, list[Row]] = {}
    for row in study.rows:
        others = {knob: value for knob, value in row.values.items() if knob != along}
        members.setdefault(label(others), []).append(row)
    return members


def cost_of_a_digit(study: StudyRows, quantity: str) -> float | None:
    """By which factor time grows for ten times less error: the median over the series.

    Only the finest model counts, since a coarse one stops improving at the error of what it leaves
    out, and of its settings those that take longer than another one and are better by half.
    """
    if quantity not in study.quantities:
        return None
    factors = []
    for rows in series(study).values():
        points = _improving([row for row in rows if row.finest], quantity)
        if len(points) < 3 or points[0][1] < _MIN_SPAN * points[-1][1]:
            continue
        times, errors = np.log10(np.array(points)).T
        factors.append(10.0 ** -float(np.polyfit(errors, times, 1)[0]))
    return float(np.median(factors)) if factors else None


def _improving(rows: Sequence[Row], quantity: str) -> list[tuple[float, float]]:
    """Time and error of the settings that are better than the faster ones."""
    pairs = [
        (row.time, row.errors[quantity].value)
        for row in rows
        if quantity in row.errors and row.errors[quantity].value >= row.errors[quantity].floor
    ]
    points: list[tuple[float, float]] = []
    for time, error in sorted(pairs):
        if error > 0 and (not points or error * _MIN_GAIN <= points[-1][1]):
            points.append((time, error))
    return points


def _costs(study: StudyRows) -> Iterator[str]:
    for name, seconds in study.reductions:
        of = f" of {name}" if name else ""
        yield f"one-off: flexible bodies{of} reduced from their meshes in {seconds_text(seconds)} s"
    compiled = [float(row.statistics.get("seconds_compile", 0.0)) for row in study.rows]
    if max(compiled) >= 1.0:
        yield f"one-off: units compiled in up to {seconds_text(max(compiled))} s"
    times = "" if study.repeats == 1 else f", median of {study.repeats} runs"
    at = "one run at a time" if study.workers == 1 else f"{study.workers} runs at the same time"
    yield f"time: wall time of the integration{times}, {at}"
    ended = [row for row in study.rows if row.seconds]
    slowed = [row for row in ended if row.time > _MAX_WAIT * row.cpu_time + _OVERHEAD]
    if slowed:
        most = max(row.time / max(row.cpu_time, 1e-9) for row in slowed)
        yield (
            f"note: other programs or the disk slowed down {len(slowed)} of {len(ended)} settings: "
            f"wall times are up to {most:.1f} times the processor times (study.csv has both)"
        )


def _failures(study: StudyRows) -> Iterator[str]:
    for row in study.rows:
        if row.status != "finished":
            what = row.reason.replace("\n", "; ")
            yield f"✗ {label(row.values)}: {what}"
    lost = sum(not math.isfinite(time) for time in study.seconds)
    if lost == len(study.rows):
        yield "no run ended: there is nothing to compare"
