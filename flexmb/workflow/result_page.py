"""``flexmb report``: one web page on a run, a comparison of runs, or a study.

In: results, or the folder of a study or a sweep. Out: one self-contained HTML file. What a result
does not contain is left out of its page and named at its end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from flexmb.errors import FlexmbError, ViewError
from flexmb.progress import Progress, silent
from flexmb.results import Result
from flexmb.results.run_summary import energy_rows, time_rows, work_rows
from flexmb.view.charts import energy_names, loaded_reactions, participating_modes
from flexmb.view.html_page import Charts, Html, check_plotly, section, table, tag, write_page
from flexmb.view.mechanism import Mechanism
from flexmb.view.page_motion import moving_scene
from flexmb.view.picture import view_of
from flexmb.view.plot import writable_file
from flexmb.view.window import Page
from flexmb.workflow.audit import TEXT as AUDIT
from flexmb.workflow.audit import Audit
from flexmb.workflow.comparison_page import PHASES, comparison_parts, foot, picture_of
from flexmb.workflow.installation import machine
from flexmb.workflow.run_report import check_frequencies, check_sensors, provenance

_ENDINGS = (".html", ".htm")
_MAX_MODES = 12
_HOT_SPOTS = 5


PARTS = (
    "summary", "motion", "pictures", "checks", "plots", "model", "effects", "accuracy", "hot_spots",
    "modes", "provenance",
)  # fmt: skip


def report(*sources: Result | str | Path, output: str | Path | None = None, **options: Any) -> Path:
    """Write a web page on a run, on several runs compared, or on a study.

    Parameters
    ----------
    *sources : Result or path
        A result, its folder, or the folder of a study or a sweep; or several results.
    output : path, optional
        The file; ``report.html`` beside the (first) source by default.
    **options
        Those of `report_page`.

    Returns
    -------
    Path
        The file; it needs no other file and no network.

    Raises
    ------
    ViewError
        The library plotly is missing, an unknown part, or there is nothing to show.
    ResultFileError
        No such result.
    OutputError
        The file cannot be written.
    """
    first = sources[0]
    home = first.path.parent if isinstance(first, Result) else Path(first)
    home = home if home.is_dir() else home.parent
    return report_page(*sources, file=writable_file(output or home / "report.html", _ENDINGS),
                       **options).save()  # fmt: skip


def report_page(
    *sources: Result | str | Path,
    parts: Sequence[str] | None = None,
    motion: bool = True,
    view: Mapping[str, Any] = MappingProxyType({}),
    progress: Progress = silent,
    file: str | Path = "report.html",
) -> Page:
    """Make the page of `report`, or some of its parts, for a notebook.

    Parameters
    ----------
    *sources : Result or path
        A result, its folder, or the folder of a study or a sweep; or several results.
    parts : sequence of str, optional
        Of the page on one run: ``"summary"``, ``"motion"``, ``"pictures"``, ``"checks"``,
        ``"plots"``, ``"model"``, ``"effects"``, ``"accuracy"``, ``"hot_spots"``, ``"modes"``,
        ``"provenance"``; all by default.
    motion : bool
        Whether the machine moves in the page.
    view : mapping
        Words of the scene's ``[view]`` for its pictures, such as ``{"camera": ["front", "top"]}``.
    progress : Progress
        Called for every phase.
    file : path
        The file that ``page.save()`` writes.

    Returns
    -------
    Page
        Its ``html``; the last line of a notebook's cell shows it.

    Raises
    ------
    ViewError, ResultFileError
        As for `report`.
    """
    from flexmb.workflow.comparison_page import is_study, study_parts

    check_plotly()
    for name in parts or ():
        if name not in PARTS:
            raise ViewError.unknown(f'a report has no part "{name}"', name, PARTS)
    first, charts, data = sources[0], Charts(), dict[str, Any]()
    single = len(sources) == 1
    if single and not isinstance(first, Result) and is_study(Path(first)):
        title, body = study_parts(Path(first), charts)
    else:
        results = [one if isinstance(one, Result) else Result(one) for one in sources]
        if view:
            view_of(Mechanism(results[0]), dict(view))  # refuses wrong options
        if single:
            page = _ResultPage(results[0], charts, progress, view)
            title, body = (
                page.title,
                page.parts([n for n in parts or PARTS if motion or n != "motion"]),
            )
            data["motion"] = page.motion
        else:
            title, body = comparison_parts(results, charts, progress, view)
    if parts is not None and "motion" not in data:
        raise ViewError("parts are those of the page on one run: leave them out here")
    text = write_page(title, body, {"charts": charts.data, **data})
    return Page(text, Path(file))


class _ResultPage:
    """The page on one run."""

    def __init__(
        self, result: Result, charts: Charts, progress: Progress, view: Mapping[str, Any]
    ) -> None:
        self.result, self.charts, self.progress, self.view = result, charts, progress, view
        self.title = result.title or result.path.parent.name
        self.motion: dict[str, Any] | None = None
        self.left_out: list[str] = []

    def parts(self, names: Sequence[str]) -> list[Html]:
        """The named parts of the page's body."""
        made = [self._attempt(getattr(self, f"_{name}")) for name in PARTS if name in names]
        return [*made, foot(self.left_out)]

    def _attempt(self, part: Callable[[], Html]) -> Html:

        try:
            return part()
        except FlexmbError as error:
            self.left_out.append(str(error))
            return Html("")

    def _summary(self) -> Html:

        run = self.result
        color = "good" if run.status == "finished" else "bad"
        badge = tag("span", run.status, class_=f"badge {color}")
        lines = [tag("h1", self.title, " ", badge)]
        lines += [tag("p", run.message, class_="bad")] if run.message else []
        figures = [(tag("b", figure), tag("span", words)) for figure, words in self._figures()]
        cards = tag("div", *(tag("div", *one, class_="card") for one in figures), class_="cards")
        notes = [tag("li", note) for note in self._notes()]
        warnings = tag("ul", *notes, class_="notes") if notes else Html("")
        return Html("".join([*lines, cards, section("Notes and warnings", warnings)]))

    def _figures(self) -> list[tuple[str, str]]:
        """The most important figures."""
        run, statistics = self.result, self.result.statistics
        cards = []
        if len(run.time):
            span = run.time[-1] - run.time[0]
            cards.append((f"{span:.4g} {run.units.label('s')}", f"simulated, {len(run.time)} rows"))
        flexible = len(run.flexbodies)
        modes = sum(body.m for body in run.layout.bodies)
        words = f"bodies, {flexible} flexible with {modes} modes" if flexible else "rigid bodies"
        cards.append((str(len(run.layout.bodies)), words))
        spent = [run.seconds[name] for name in PHASES if name in run.seconds]
        if spent:
            steps = statistics.get("steps", statistics.get("points", ""))
            kind = "steps" if "steps" in statistics else "points"
            cards.append((f"{sum(spent):.3g} s", f"of computing, {steps} {kind}"))
        for key, words in (
            ("measured_error_of_positions", "measured error, of the peak-to-peak"),
            ("energy_balance_error", "energy balance error, of the energy moved"),
            ("largest_position_drift", "drift of the joints, m or rad"),
        ):
            if key in statistics:
                cards.append((f"{float(statistics[key]):.1e}", words))
        return cards

    def _notes(self) -> list[str]:
        run = self.result
        notes = list(run.notes)
        if run.reactions_not_unique:
            names = ", ".join(run.reactions_not_unique)
            notes.append(f"reactions not unique at {names}: their least values are shown")
        if AUDIT in run.texts:
            notes.append(Audit.from_text(run.texts[AUDIT]).sentence())
        return notes

    def _motion(self) -> Html:
        scene = moving_scene(self.result, self.progress)
        self.motion = scene.data
        return section("In motion", scene.player(), class_="on-screen")

    def _pictures(self) -> Html:

        run = self.result
        if not run.has_columns("q"):
            raise FlexmbError('no pictures: not all poses were kept (keep = ["poses"])')
        self.progress("pictures", 0.0)
        looks: list[tuple[str | None, float | None, str]] = [("displacement", None, "")]
        if "color" in self.view:
            looks = [(None, None, "")]
        for body in run.flexbodies if "color" not in self.view else ():
            if run.flexbody(body).stress is not None:
                peak = run.peak_von_mises(body)
                time = float(peak.time[peak.place])
                if not peak.values.any():
                    continue
                looks.append(("von_mises", time, f"at the largest stress of {body}"))
                break
        figures = [picture_of(run, *look, self.view) for look in looks]
        self.progress("pictures", 1.0)
        return section("Pictures", tag("div", *figures, class_="pair") if figures else Html(""))

    def _checks(self) -> Html:

        run, model = self.result, self.result.scene_model
        bodies = {c.body: run.flexbody(c.body) for c in model.frequency_checks
                  if c.body in run.flexbodies}  # fmt: skip
        outcomes = [*check_sensors(model, run), *check_frequencies(model, bodies)]
        if not outcomes:
            return section("", "")
        unit = run.units.label("s")
        rows = [
            (
                tag(
                    "span", "ok" if o.passed else "open" if o.is_open else "failed",
                    class_="good" if o.passed else "bad",
                ),  # fmt: skip
                o.place(unit), f"{o.value:.9g}", f"{o.expected:.9g}",
                f"{abs(o.value - o.expected):.2g}", f"{o.tolerance:.2g}", o.source,
            )
            for o in outcomes
        ]  # fmt: skip
        columns = ("", "of", "value", "expected", "off by", "allowed", "source")
        return section("Known answers", table(columns, rows, right=(2, 3, 4, 5)))

    def _plots(self) -> Html:

        run, parts = self.result, list[Html]()
        if not len(run.time):
            raise FlexmbError(f"{run.path}: the result has no rows to draw")
        for title, names in (
            ("Sensors", ()),
            ("Reactions", loaded_reactions([run])),
            ("Energy", energy_names([run])),
            ("Strain energy by mode", participating_modes([run])),
        ):
            try:
                charts = self.charts.histories(run, names) if names or title == "Sensors" else []
            except FlexmbError as error:
                self.left_out.append(str(error))
                continue
            parts += [tag("h3", title), *charts] if charts else []
        return section("Plots", *parts)

    def _model(self) -> Html:
        from flexmb.model.joints.joint import count
        from flexmb.model.scenes.conversion import gravity_in_words
        from flexmb.workflow.check import counts_table

        run, model = self.result, self.result.scene_model
        counts = [(name, str(n)) for name, n in counts_table(count(model)).items() if n]
        bodies = []
        for name, spec in model.bodies.items():
            flexible = name in run.flexbodies
            body = run.flexbody(name) if flexible else None
            mass = body.mass if body is not None else getattr(spec, "mass", None)
            kind = f"flexible, {body.m} modes" if body is not None else "rigid"
            bodies.append((name, kind, "" if mass is None else run.units.say(float(mass), "kg")))
        joints = [(n, j.type, " – ".join(j.between)) for n, j in model.joints.items()]
        joints += [(n, "driver", str(getattr(d, "joint", None) or getattr(d, "marker", None) or ""))
                   for n, d in model.drivers.items()]  # fmt: skip
        forces = [(n, str(getattr(f, "type", "")), _place_of(f)) for n, f in model.forces.items()]
        return section(
            "What was simulated",
            tag("p", gravity_in_words(run.model.get("gravity"), run.units)),
            tag("div", table(("counts", ""), counts, right=(1,)),
                table(("body", "", "mass"), bodies, right=(2,)), class_="pair"),
            table(("joint", "type", "between"), joints),
            table(("force", "type", "between or at"), forces),
        )  # fmt: skip

    def _effects(self) -> Html:

        run, parts = self.result, list[Html]()
        rows = []
        for name in run.flexbodies:
            spec: Any = run.scene_model.bodies[name]
            words = getattr(spec, "effects_in_words", None)
            if words is not None:
                rows.append((name, words(run.flexbody(name))))
        parts.append(table(("flexible body", "effects in the run"), rows))
        if AUDIT in run.texts:
            made = Audit.from_text(run.texts[AUDIT])
            columns, cells = made.table()
            parts += [
                tag("h3", "Audit"),
                table(columns, cells, right=(4, 7)),
                tag("p", made.sentence()),
            ]
            parts += [tag("p", note) for note in made.notes]
        elif rows:
            hint = f"No audit was made: flexmb audit {run.path.parent} says what each contributes."
            parts.append(tag("p", hint, class_="lead"))
        dampings = [(d.body or "together", d.words, d.summary()) for d in run.damping.values()]
        parts.append(table(("damping of", "as the scene says", "as joined"), dampings))
        return section("Effects", *parts)

    def _accuracy(self) -> Html:

        run = self.result
        parts = [
            table(("the run", "", ""), work_rows(run.statistics, run.units), right=(1,)),
            table(("wall time by phase", "s", ""), time_rows(run.statistics), right=(1,)),
        ]
        if len(run.time):
            unit = run.units.label("J")
            columns = (f"energy [{unit}]", "at the end", "least", "greatest")
            parts.append(table(columns, energy_rows(run), right=(1, 2, 3)))
        return section("Accuracy and cost", *parts)

    def _hot_spots(self) -> Html:

        run, rows = self.result, []
        unit, second = run.units.label("Pa"), run.units.label("s")
        for name in run.flexbodies:
            if run.flexbody(name).stress is None or not len(run.time):
                continue
            peak = run.peak_von_mises(name)
            if not peak.values.any():
                self.left_out.append(f"{name} has no stress: it does not deform in this run")
                continue
            nodes = set[int]()
            for place in np.argsort(-peak.values):
                node = int(peak.node[place])
                if node not in nodes and len(nodes) < _HOT_SPOTS:
                    nodes.add(node)
                    where = " of ".join(filter(None, (peak.layer[place], peak.part[place])))
                    value, time = f"{peak.values[place]:.4g}", f"{peak.time[place]:.5g}"
                    rows.append((name, value, time, str(node), where))
        columns = ("body", f"von Mises stress [{unit}]", f"at t [{second}]", "mesh node", "")
        return section("Hot spots", table(columns, rows, right=(1, 2, 3)))

    def _modes(self) -> Html:

        parts = []
        for name in self.result.flexbodies:
            body = self.result.flexbody(name)
            modes = [mode for mode in body.modes if mode.kept]
            rows = [
                (str(mode.index), f"{mode.frequency:.5g}", mode.kind, mode.mostly, mode.why)
                for mode in modes
            ]
            columns = ("mode", "Hz, free body", "", "mostly", "why")
            parts += [
                tag("h3", f"{name}: {body.m} modes"),
                table(columns, rows[:_MAX_MODES], right=(0, 1)),
            ]
            if more := rows[_MAX_MODES:]:
                words = tag("summary", f"{len(more)} more modes of {name}")
                parts.append(tag("details", words, table(columns, more, right=(0, 1))))
        return section("Modes of the flexible bodies", *parts)

    def _provenance(self) -> Html:

        run = self.result
        data = provenance(run)
        rows = [("result", str(run.path)), ("run started", run.created)]
        rows += [(k.replace("_", " "), _text(v)) for k, v in data.items() if k != "bodies" and v]
        for name, hashes in data.get("bodies", {}).items():
            rows.append((f"flexible body {name}", f"hash {hashes.get('hash', '')[:16]}"))
        for name in run.flexbodies:
            words = run.flexbody(name).provenance
            rows += [(f"{name}: {key}", words[key]) for key in ("mesh", "mesh sha256", "material",
                     "reduction", "versions") if words.get(key)]  # fmt: skip
        rows.append(("this page", machine()))
        scene = run.texts.get("scene", "")
        text = tag("details", tag("summary", "The scene"), tag("pre", scene)) if scene else ""
        return section("Provenance", table(("", ""), rows), text)


def _place_of(force: Any) -> str:
    between = getattr(force, "between", None)
    return " – ".join(between) if between else str(getattr(force, "at", None) or "")


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} = {x}" for key, x in value.items())
    return str(value)
