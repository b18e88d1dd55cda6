"""``effects = "auto"``: the cheapest set of effects that keeps a budget on every sensor.

The scene runs with rigid bodies. The audit of that run says which bodies must be flexible, and
whether they vibrate. The scene then runs with these effects, is audited along the new motion, and
effects that contribute too much are switched on, until the omitted ones stay within the budget. The
levels of a body are rigid, quasi-static, vibrating with constant inertia coupling, partial coupling
with geometric stiffening, and full coupling with it. Centrifugal softening without stiffening is
never selected (Padilla & von Flotow, J. Guidance 15 (1992) 131). Options that a scene states for a
body are not changed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import FlexmbError
from flexmb.model.flexible_body import stretches
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.scenes.effects import with_words
from flexmb.progress import Progress, silent
from flexmb.workflow.audit import MISSING, Audit, EarlierAudits, EffectOutcome, audit_until
from flexmb.workflow.effect import (
    BOTH,
    COUPLING,
    DEFORMATION,
    MEMBRANE,
    MODES,
    STATIC,
    STIFFENING,
    VIBRATION,
    Effect,
    percent,
)
from flexmb.workflow.run import run_single
from flexmb.workflow.run_report import RunReport, draw_run

if TYPE_CHECKING:
    from flexmb.model import Model

TEXT = "effects"
"""Name of the text in a result with the selected effects and the reasons."""
COLUMNS = ("run", "of", "switched to", "because", "contribution", "at")
"""Columns of the table of a selection."""
# fraction of the budget that all omitted effects may use together, since they are estimates
_OMITTED_SHARE = 0.5
_MAX_RUNS = 8
_FULL = f"full {COUPLING}"
# replacements of options of a body whose frame is at an interface
_FRAMED = {"quasi-static": "dynamic", "partial": "full"}
_WORDS: dict[str, dict[str, Any]] = {
    DEFORMATION: {"deformation": "quasi-static"},
    VIBRATION: {"deformation": "dynamic"},
    STATIC: {"deformation": "dynamic"},
    BOTH: {"inertia_coupling": "partial", "geometric_stiffening": "full"},
    COUPLING: {"inertia_coupling": "partial"},
    STIFFENING: {"geometric_stiffening": "full"},
    _FULL: {"inertia_coupling": "full"},
    MEMBRANE: {"membrane_forces": "full", "deformation": "dynamic"},
}
_R = "rigid"
# for bodies that can be neither rigid nor quasi-static
_FULL_DEFORMATION = {"deformation": "dynamic"}
_LOWEST = {
    "deformation": _R, "inertia_coupling": "constant", "geometric_stiffening": "none",
}  # fmt: skip


@dataclass
class Selection:
    """The effects that were switched on, run by run.

    Attributes
    ----------
    words : dict of str to dict
        Final options of each flexible body, among those that the scene leaves open.
    framed : frozenset of str
        Bodies with their frame at an interface: there quasi-static modes have no momentum, and
        partial coupling may diverge. Bodies with membrane forces, which such modes do not know.
    steps : list of tuple of str
        Rows under `COLUMNS`.
    """

    words: dict[str, dict[str, Any]]
    framed: frozenset[str] = frozenset()
    steps: list[tuple[str, ...]] = field(default_factory=list)

    def text(self) -> str:
        """The selection as JSON, for the result file."""
        return json.dumps({"words": self.words, "columns": COLUMNS, "steps": self.steps})

    def switch(self, body: str, words: Mapping[str, Any], *why: str) -> bool:
        """Change options of a body that are open, and note why; returns whether any changed."""
        changes = self.changes(body, words)
        self.words[body].update(changes)
        if changes:
            text = ", ".join(f"{key} = {value}" for key, value in changes.items())
            self.steps.append((why[0], body, text, *why[1:]))
        return bool(changes)

    def changes(self, body: str, words: Mapping[str, Any]) -> dict[str, Any]:
        """What words would change of the options of a body that are open."""
        mine = self.words[body]
        if body in self.framed:
            words = {key: _FRAMED.get(word, word) for key, word in words.items()}
        if mine.get("deformation") == "dynamic":  # what vibrates deforms as well
            words = {**words, "deformation": "dynamic"}
        return {key: value for key, value in words.items() if mine.get(key, value) != value}

    def may_switch(self, effect: Effect) -> bool:
        """Whether an effect that is off has words that are open."""
        return bool(self.changes(effect.body, _words_of(effect.name, effect.indicator)))

    def apply(self, model: Model) -> Model:
        """The model with the selected options, with nothing left to be selected."""
        stated = model.effects
        assert stated is not None
        model = with_words(model, self.words)
        model.effects = stated.model_copy(update={"choice": "as stated"})
        if model.source is not None:
            words = {
                f"bodies.{name}.{key}": value
                for name, mine in self.words.items()
                for key, value in mine.items()
            }
            words["effects.choice"] = "as stated"
            model.source = model.source._replace(overrides={**model.source.overrides, **words})
        return model


def run_with_selected_effects(
    model: Model, output: Path, *, pictures: bool = True, progress: Progress = silent,
    **options: Any,
) -> RunReport:  # fmt: skip
    """Select the effects of a model and run it with them; the last run is the result.

    Parameters
    ----------
    model : Model
        With ``effects = "auto"``.
    output : Path
        Folder of the result.
    pictures : bool
        Whether to draw the last run.
    progress : Progress
        Called for every phase.
    **options
        As for `run_single`.

    Raises
    ------
    FlexmbError
        As `run_single`.
    """
    from flexmb.analysis.validity.membrane_forces import LEFT_OUT
    from flexmb.results import Result
    from flexmb.results.writer import store_text

    model.validate()
    assert model.effects is not None
    budget = model.effects.budget
    flexible: dict[str, Any] = {k: spec for k, spec in model.bodies.items() if spec.flexible}
    selection = Selection(
        {name: _open_words(spec) for name, spec in flexible.items()},
        frozenset(
            name
            for name, spec in flexible.items()
            if spec.frame_interface is not None or stretches(spec)
        ),
    )
    earlier = EarlierAudits()
    made: Audit | None = None
    first: FlexmbError | None = None  # the first of consecutive failures
    for number in map(str, range(1, _MAX_RUNS + 1)):
        try:
            report = run_single(
                selection.apply(model), output, pictures=False, progress=progress, **options
            )
        except FlexmbError as error:
            first = first or error
            lacking = [body for body in flexible if f"bodies.{body}: {LEFT_OUT}" in str(error)]
            if _add_membrane_forces(selection, flexible, lacking, number, MEMBRANE, "", ""):
                continue
            why = str(error).splitlines()[0].partition("; ")[0]
            if not _raise_all_bodies(selection, number, why):
                raise first from None
            continue
        first = None
        run = Result(report.result)
        if run.status != "finished":
            return report
        made = audit_until(
            run, budget, progress, partial(_switch_on, selection, number=number, budget=budget),
            selection.may_switch, earlier=earlier,
        )  # fmt: skip
        if made is not None:
            lacking = [one.body for one in made.effects
                       if one.effect == MEMBRANE and one.verdict == MISSING]  # fmt: skip
            if not _add_membrane_forces(selection, flexible, lacking, number, MEMBRANE, "", ""):
                break
            made = None
    made = made or audit_until(run, budget, progress, earlier=earlier)
    assert made is not None
    store_text(run.path, TEXT, selection.text())
    picture, history = draw_run(run, progress) if pictures else (None, None)
    steps = selection.steps or [("1", "", "nothing", "all stays within the budget", "", "")]
    from flexmb.analysis.validity.omitted_vibrations import LEFT_OUT as NO_VIBRATIONS

    beside = "; the sensors stay within the budget, stresses may not" if made.passed else ""
    notes = [note + beside * (NO_VIBRATIONS in note) for note in report.notes]
    return replace(
        report, picture=picture, history=history, notes=[*notes, made.sentence()],
        tables=((COLUMNS, tuple(steps)), made.table()),
    )  # fmt: skip


def _open_words(spec: Any) -> dict[str, Any]:
    """The lowest level of a body, for options that the scene does not state."""
    words: dict[str, Any] = {
        key: word for key, word in _LOWEST.items() if key not in spec.model_fields_set
    }
    if isinstance(spec, MeshBodySpec) and spec.modes is None and spec.reduction != "guyan":
        words["modes"] = spec.mode_count
    return words


def _raise_all_bodies(selection: Selection, number: str, why: str) -> bool:
    """Raise all bodies by one level because a run failed; False if they are at the highest."""
    open_ = [k for k, words in selection.words.items() if words.get("deformation") != "dynamic"]
    if any([selection.switch(k, _FULL_DEFORMATION, number, why, "", "") for k in open_]):
        return True
    constant = [
        k for k, words in selection.words.items() if words.get("inertia_coupling") == "constant"
    ]
    return any([selection.switch(k, _WORDS[BOTH], number, why, "", "") for k in constant])


def _add_membrane_forces(
    selection: Selection, flexible: Mapping[str, Any], lacking: Iterable[str], *why: str
) -> bool:
    """Switch membrane forces on, where the scene leaves them open and all modes may be dynamic."""
    changed = False
    for body in lacking:
        spec, words = flexible[body], selection.words[body]
        is_open = "deformation" in words or spec.deformation == "dynamic"
        needed = dict(_WORDS[MEMBRANE])
        if spec.frame_interface is not None and spec.geometric_stiffening != "full":
            needed |= _WORDS[STIFFENING]
        if is_open and spec.model_fields_set.isdisjoint(needed.keys() - {"deformation"}):
            words.setdefault("membrane_forces", "none")
            changed |= selection.switch(body, needed, *why)
    return changed


def _words_of(effect: str, indicator: str) -> dict[str, Any]:
    """Words that switch an effect on."""
    return {"modes": int(indicator.split()[0]) * 2} if effect == MODES else _WORDS[effect]


def _switch_on(
    selection: Selection, effects: Sequence[EffectOutcome], *, number: str, budget: float,
) -> bool:  # fmt: skip
    """Switch on effects that would let the sum of the omitted ones exceed its share of the budget.

    The smallest contributions stay off as long as their sum at every sensor allows it. An effect
    whose contribution is not known, because sensors vibrate faster than the rows resolve or its
    estimate failed, is switched on.

    The contributions of those that no option of the selection switches may not be known yet: what
    exceeds the budget without them does so with them. They are computed where nothing else does.
    """
    sums: dict[str, float] = {}
    off = [one for one in effects if not one.on and (one.shares or one.is_failure) and one.body]
    off = [one for one in off if one.share is not None or one.effect != MODES]
    wanted: list[EffectOutcome] = []
    for one in sorted(off, key=lambda one: inf if one.share is None else one.share):
        together = {name: sums.get(name, 0.0) + share for name, share in one.shares.items()}
        if one.share is not None and max(together.values()) <= _OMITTED_SHARE * budget:
            sums |= together
            continue
        wanted.append(one)
    changed = False
    for one in wanted:
        share = "not known" if one.is_failure else percent(one.share)
        words = _words_of(one.effect, one.indicator)
        changed |= selection.switch(one.body, words, number, one.effect, share, one.sensor)
    return changed
