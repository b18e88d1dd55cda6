"""Neighbouring models of a run: its scene with one effect more, or one less.

An effect is switched by the words of the scene alone, so that the neighbour can be linearised about
the motion of the run, and run as well. Centrifugal softening is never looked at without geometric
stiffening: of the two left out, neither is judged alone (Padilla & von Flotow).
"""

from __future__ import annotations

import copy
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array
from flexmb.folders import writable_folder
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.scenes.effects import active_model, with_words
from flexmb.progress import Progress, silent
from flexmb.workflow.audited_rows import resolved_motion
from flexmb.workflow.effect import (
    DAMPING,
    DEFORMATION,
    FULL,
    MODES,
    OUT_OF_PLANE,
    STATIC,
    VIBRATION,
    Effect,
    couplings,
)

if TYPE_CHECKING:
    from flexmb.analysis.effects.contribution import Contribution
    from flexmb.analysis.effects.stored_motion import Motion
    from flexmb.engine.compile import Compiled
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.results.output_block import OutputBlock

Change: TypeAlias = tuple[tuple[Array, ...], Array, tuple[str, ...], float | None]
"""Channels as for `contributions`, an effect's change of them (n, k), names, its cost."""

_MORE_MODES = 2  # times as many modes tell what those left out would do
_FEW_ROWS, _FEWER = 800, 8  # of more rows an eighth tells first whether all of them are needed
_NOTHING = 1e-7  # of a sensor's peak-to-peak; too few rows saw 1/40 of a change
_RIGID, _DYNAMIC = {"deformation": "rigid"}, {"deformation": "dynamic"}
_QUASI_STATIC = {"deformation": "quasi-static"}
_FRAMED = "quasi-static modes keep no momentum in a frame at an interface; take mean axes"


@dataclass
class Neighbours:
    """A run with its model, and the models next to it.

    Attributes
    ----------
    folder : Path
        For runs and reductions that the estimates need; what is there already is used again.
    """

    run: Result
    model: Model
    bodies: Mapping[str, FlexBody]
    compiled: Compiled
    motion: Motion
    folder: Path
    progress: Progress = silent
    notes: list[str] = field(default_factory=list)
    _unsettled: set[str] = field(default_factory=set)  # sensors, of the effect that was last found
    _unsettled_of: dict[tuple[str, ...], set[str]] = field(default_factory=dict)
    _changes_of: dict[tuple[str, ...], Change] = field(default_factory=dict)
    _runs: int = 0  # of other words
    _rigid: dict[tuple[str, ...], tuple[Compiled, Motion, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, run: Result, most_rows: int, progress: Progress = silent) -> Neighbours:
        """The model of a run, and at most so many of its rows."""
        from flexmb.analysis.effects.stored_motion import read_motion
        from flexmb.engine.compile import compile_system
        from flexmb.flexbody import load
        from flexmb.model import Model
        from flexmb.workflow.compiled_model import damped_as_run
        from flexmb.workflow.flexible_bodies import SIMULATED
        from flexmb.workflow.resume import load_bodies

        model = Model.from_scene_dict(run.model, run.path.parent)
        bodies = load_bodies(run)
        folder = run.path.parent / "audit"
        compiled = damped_as_run(compile_system(model, bodies), model, run)
        for name, file in run.flexbodies.items():
            whole = file.with_name(file.name.replace(SIMULATED, "."))
            bodies[name] = load(whole) if whole != file and whole.exists() else bodies[name]
        made = cls(run, model, bodies, compiled, read_motion(run), folder, progress)
        again = None if "from" in made._origin else partial(made._run, name="rows")
        made.motion, made.notes = resolved_motion(made.motion, compiled, model, most_rows, again)
        return made

    def rows(self) -> OutputBlock:
        """The rows as a block of outputs."""
        from flexmb.results.output_block import OutputBlock

        m, none = self.motion, np.zeros((len(self.motion.t), 0))
        return OutputBlock(m.t, m.q, m.v, m.vd, m.lam, none, m.channels, none, none)

    def effects(self) -> Iterator[Effect]:
        """The effects of flexible bodies, body by body."""
        for name, spec in self.model.bodies.items():
            if spec.flexible:
                yield from self._of_body(name)

    def neighbour(self, *effects: Effect) -> Model:
        """The scene with an effect switched over, or with one of several bodies."""
        if effects[0].body:
            return with_words(self.model, {one.body: one.words for one in effects})
        model = copy.copy(self.model)
        stated = {} if model.effects is None else model.effects.model_dump()
        model.set_effects(**{**stated, **effects[0].words})
        return model

    def estimate(self, effect: Effect) -> tuple[list[Contribution], float | None]:
        """Contributions to the sensors, and the time of the equations with it over that without.

        Of deformation the time is that of all evaluations of the run over those of the rigid one.

        Raises
        ------
        FlexmbError
            The neighbour cannot be made or run.
        """
        from flexmb.analysis.effects.contribution import shared

        alike, cost, made = self._alike(effect), self._change(effect)[3], self._alone(effect)
        if len(alike) > 1 and not effect.on and effect.name != MODES:
            with suppress(FlexmbError):  # without them all there may be no motion
                return shared(made, self._each(alike), self._alone(*alike)), cost
        if effect.body and len(alike) > 1 and any(one.at_rest and one.share for one in made):
            made = self._each(alike)[alike.index(effect)]
        return made, cost

    def _each(self, effects: Sequence[Effect]) -> list[list[Contribution]]:
        """Of one effect after the other, beside what they change together to first order."""
        with np.errstate(invalid="ignore"):  # of what is unbounded
            together = np.sum([self._change(one)[1] for one in effects], axis=0)
        return [self._alone(one, together=together) for one in effects]

    def _alone(self, *effects: Effect, together: Array | None = None) -> list[Contribution]:
        """Of one effect, or of some of one kind switched over together."""
        from flexmb.analysis.effects.contribution import contributions

        made = contributions(self.model, *self._change(*effects)[:3], together)
        rough = self._unsettled_of[effects[0].name, *(one.body for one in effects)]
        return [replace(one, unsettled=one.sensor in rough) for one in made]

    @cached_property
    def _static(self) -> dict[str, Any]:
        """Bodies with quasi-static modes, and their words."""
        from flexmb.engine.ordering import quasi_static

        bodies = self.compiled.flexbodies
        specs: Mapping[str, Any] = self.model.bodies
        return {
            k: specs[k].deformation for k in bodies if quasi_static(specs[k], bodies[k], self.model)
        }

    @cached_property
    def _dynamic(self) -> tuple[Model, Compiled]:
        """The scene with inertia of all modes that the run has."""
        model = with_words(self.model, dict.fromkeys(self._static, _DYNAMIC))
        return model, self._compile(model, self.bodies) if self._static else self.compiled

    @cached_property
    def _estimable(self) -> list[Effect]:
        return [effect for effect in self.effects() if not effect.why]

    def _alike(self, effect: Effect) -> list[Effect]:
        """The effects of this kind that are off, or on, as this one is, in bodies alike."""
        kind, rigid = (effect.name, effect.on), effect.indicator == "rigid"
        alike = [one for one in self._estimable if (one.name, one.on) == kind]
        return [one for one in alike if (one.indicator == "rigid") == rigid]

    def _change(self, *effects: Effect) -> Change:
        """By one effect, or by some of one kind together."""
        name = effects[0].name
        key = (name, *(one.body for one in effects))
        if key not in self._changes_of:
            deforms = name in (DEFORMATION, VIBRATION)
            find = self._deformation if deforms else self._switch_change
            self._unsettled = set()
            self._changes_of[key] = find(*effects)
            self._unsettled_of[key] = self._unsettled
        return self._changes_of[key]

    def _switch_change(self, *effects: Effect) -> Change:
        """Of all but deformation, along the motion of the run; modes without inertia follow it."""
        from flexmb.analysis.effects.contribution import evaluation_time as time
        from flexmb.analysis.effects.stored_motion import shapes_of

        model, own, follow = self.neighbour(*effects), self.compiled, False
        name, on = effects[0].name, effects[0].on
        if name != STATIC and self._static:
            own, follow = self._dynamic[1], "quasi-static" in self._static.values()
            model = with_words(model, dict.fromkeys(self._static, _DYNAMIC))
        bodies, shapes = dict(self.bodies), {}
        for one in effects:
            if one.body and (name == MODES or one.words.get("geometric_stiffening")):
                bodies[one.body] = self._reduced(model, one)
        if name == OUT_OF_PLANE:
            for body, spec in model.bodies.items():
                if isinstance(spec, MeshBodySpec):  # in the plane as many modes as the run has
                    model = with_words(model, {body: {"modes": _MORE_MODES * spec.mode_count}})
                    bodies[body] = self._reduced(model, replace(effects[0], body=body))
        other = self._compile(model, bodies)
        finer = {OUT_OF_PLANE: own.flexbodies, MODES: [one.body for one in effects]}
        for body in finer.get(name, ()):
            shapes[body] = shapes_of(own.flexbodies[body], other.flexbodies[body])
        changes = self._few_changes(own, other, model, shapes, follow)
        changes = changes or self._changes(own, other, model, self.motion, shapes, follow)
        times = time(other), time(own) if self._static else self._own_time
        return *changes, times[1] / times[0] if on else times[0] / times[1]

    def _of_body(self, name: str) -> Iterator[Effect]:
        from flexmb.analysis.dynamics.linear_elasticity import LEAST_SPEED
        from flexmb.analysis.effects.contribution import indicators
        from flexmb.engine.ordering import quasi_static

        spec: Any = self.model.bodies[name]
        body = self.compiled.flexbodies[name]
        if body.m == 0:
            if self.bodies[name].m or spec.deformation == "rigid":
                yield Effect(DEFORMATION, name, False, "rigid", _DYNAMIC)
                yield Effect(VIBRATION, name, False, "rigid", _DYNAMIC)
            return
        numbers = indicators(self.compiled, self.motion, body, name)
        yield Effect(DEFORMATION, name, True, f"u/L {numbers.deflection:.2g}", _RIGID)
        fast, turning = f"f/f1 {numbers.excitation:.2g}", f"Ω/ω1 {numbers.speed:.2g}"
        if spec.deformation != "quasi-static":
            yield Effect(VIBRATION, name, True, fast, _QUASI_STATIC)
            if static := quasi_static(spec, body, self.model):
                yield Effect(STATIC, name, False, f"{len(static)} of {body.m}", _DYNAMIC)
        else:
            why = "" if spec.frame_interface is None else _FRAMED
            yield Effect(VIBRATION, name, False, fast, _DYNAMIC, why)
        yield from couplings(
            name, spec, body, self.bodies[name], turning, numbers.speed < LEAST_SPEED
        )
        yield self._modes(name, spec, body)
        number = [one.name for one in self.compiled.layout.bodies].index(name)
        if self.compiled.system.parts.bodies["damped"][number]:
            yield Effect(DAMPING, name, True, "", {"damping": 0.0})

    def _modes(self, name: str, spec: Any, body: FlexBody) -> Effect:
        modes = f"{body.m} modes"
        if not isinstance(spec, MeshBodySpec) or spec.reduction in ("user", "guyan"):
            return Effect(MODES, name, False, modes, {}, "needs the mesh of the body")
        return Effect(MODES, name, False, modes, {"modes": _MORE_MODES * max(spec.mode_count, 4)})

    def _deformation(self, *effects: Effect) -> Change:
        """Of bodies along the motion in which they are rigid; of vibrations less what is slow.

        What vibrates in the run, or is quasi-static in it, does so along the motion in which these
        bodies follow their loads, if there is one.
        """
        from flexmb.analysis.effects.contribution import smaller_range
        from flexmb.engine.bodies.static_modes import static_coordinates

        mine = [one.body for one in effects]
        if effects[0].name == VIBRATION and all(self.compiled.flexbodies[k].m for k in mine):
            with suppress(FlexmbError):  # of a run of its own
                if made := self._vibration(effects[0].on, mine):
                    return made
        own, motion, model, bodies, last = self._deformable(effects)
        other = self._compile(model, bodies)
        if effects[0].name == DEFORMATION:
            cost = _evaluations(self.run) * self._own_time / last if last else None
            histories, change, names = self._changes(own, other, model, motion, {})
            return (self.motion.channels, *histories), change, names, cost
        deformations = (replace(one, name=DEFORMATION) for one in effects)
        histories, change, names, _ = self._change(*deformations)
        both = (with_words(one, dict.fromkeys(mine, _QUASI_STATIC)) for one in (self.model, model))
        beside, slow = (self._compile(one, bodies) for one in both)
        if follow := len(static_coordinates(beside.system, kinetostatic=True)) > 0:
            slow = other  # nothing vibrates, nor do other bodies on the compliance of this one
        (_, after), still, _ = self._changes(own, slow, model, motion, {}, follow)
        if motion is not self.motion:  # the body is flexible in both
            without = after if effects[0].on else smaller_range(after, histories[0])
            histories = histories[0], without, histories[2]
        change = np.where(np.isfinite(change), change - still, change)
        return histories, change, names, None

    def _vibration(self, on: bool, mine: list[str]) -> Change | None:
        """Of bodies along the motion in which they are quasi-static.

        What that leaves out of balance at their modes drives it. None where bodies that vibrate
        have no such motion: in a frame at an interface, or beside dynamic modes on which they ring.
        """
        from flexmb.engine.bodies.static_modes import static_bodies

        words, specs = dict.fromkeys(mine, _QUASI_STATIC), cast("Any", self.model.bodies)
        now = self._compile(with_words(self.model, words), self.bodies)
        framed = any(specs[name].frame_interface is not None for name in mine)
        if on and (framed or not static_bodies(now.system)[1]):
            return None
        motion = self._motion_with(words)[0] if on else self.motion
        model = with_words(self.model, dict.fromkeys(mine, _DYNAMIC))
        other = self._compile(model, self.bodies)
        histories, change, names = self._changes(now, other, model, motion, {}, inertia=mine)
        return ((self.motion.channels, *histories) if on else histories), change, names, None

    def _deformable(
        self, effects: tuple[Effect, ...]
    ) -> tuple[Compiled, Motion, Model, dict[str, FlexBody], float]:
        """The scene with bodies rigid, and its motion; with them flexible, and its bodies."""
        names, bodies = tuple(one.body for one in effects), dict(self.bodies)
        own, motion, last = self._without(names)
        model = with_words(self._dynamic[0], dict.fromkeys(names, _DYNAMIC))
        for one in effects:
            name, body, spec = one.body, bodies[one.body], model.bodies[one.body]
            has_mesh = isinstance(spec, MeshBodySpec)
            has_data = body.centrifugal_stiffness is not None
            if self.compiled.flexbodies[name].m == 0 and (has_mesh or has_data):
                model = with_words(model, {name: FULL})  # it comes shorter as it bends, if slow too
            full = getattr(model.bodies[name], "geometric_stiffening", None) == "full"
            if has_mesh and (body.m == 0 or (full and not has_data)):
                bodies[name] = self._reduced(model, one)
        return own, motion, model, bodies, last

    def _changes(
        self, own: Compiled, other: Compiled, model: Model, motion: Motion,
        shapes: Mapping[str, Array], follow: bool = False, inertia: Sequence[str] = (),
    ) -> tuple[tuple[Array, ...], Array, tuple[str, ...]]:  # fmt: skip
        from flexmb.analysis.effects.contribution import estimate

        made, settled = estimate(
            own, other, model, motion, shapes,
            begins_as_placed="from" not in self._origin, quasi_static=follow, inertia=inertia,
        )  # fmt: skip
        change, channels = made.channels, np.array(other.layout.channels)
        rough = {str(channel).split(".")[0] for channel in channels[~settled]}
        self._unsettled = self._unsettled | rough
        after = motion.channels + np.where(np.isfinite(change), change, 0.0)
        return (motion.channels, after), change, other.layout.channels

    def _few_changes(
        self, own: Compiled, other: Compiled, model: Model, shapes: Mapping[str, Array],
        follow: bool,
    ) -> tuple[tuple[Array, ...], Array, tuple[str, ...]] | None:  # fmt: skip
        """As `_changes`, of a part of many rows, where these change next to nothing; else None."""
        from flexmb.analysis.effects.contribution import contributions

        n = len(self.motion.t)
        if n <= _FEW_ROWS:
            return None
        few = self.motion.thinned(n // _FEWER)
        histories, change, names = self._changes(own, other, model, few, shapes, follow)
        if any(one.share > _NOTHING for one in contributions(model, histories, change, names)):
            return None
        every = -(-n // len(few.t))
        return 2 * (self.motion.channels,), np.repeat(change, every, axis=0)[:n], names

    def _without(self, names: tuple[str, ...]) -> tuple[Compiled, Motion, float]:
        """The scene with bodies rigid, all modes of others with inertia, and its motion."""
        from flexmb.analysis.effects.contribution import evaluation_time

        if all(self.compiled.flexbodies[name].m == 0 for name in names):
            return self._dynamic[1], self.motion, 0.0
        if names not in self._rigid:
            words = dict.fromkeys(names, _RIGID)
            motion, evaluations = self._motion_with(words)
            own = self._compile(with_words(self._dynamic[0], words), self.bodies)
            self._rigid[names] = own, motion, evaluations * evaluation_time(own)
        return self._rigid[names]

    def _motion_with(self, words: Mapping[str, Mapping[str, str]]) -> tuple[Motion, float]:
        """The motion of the scene with other words of bodies, and how many evaluations it takes."""
        from flexmb.analysis.effects.stored_motion import read_motion

        model, finer = with_words(self.model, words), {"outputs": len(self.motion.t) - 1}
        if model.dynamics is not None and self.notes:  # the rows of another run
            model.dynamics = model.dynamics.model_copy(update=finer)
        self._runs += 1
        run = self._run(model, f"switched_{self._runs}")  # names of bodies are of any length
        return read_motion(run).thinned(len(self.motion.t)), _evaluations(run)

    @cached_property
    def _own_time(self) -> float:
        from flexmb.analysis.effects.contribution import evaluation_time

        return evaluation_time(self.compiled)

    @cached_property
    def _origin(self) -> dict[str, Any]:
        from flexmb.workflow.run_report import provenance

        return provenance(self.run)

    def _compile(self, model: Model, bodies: Mapping[str, FlexBody]) -> Compiled:
        """The model with the damping of its modes as they are joined in the first row."""
        from flexmb.analysis.assembly.joined_damping import add_damping, choose_static_modes
        from flexmb.engine.compile import compile_system

        compiled = compile_system(model, bodies)
        q = compiled.initial_q.copy()
        for now, then in zip(compiled.layout.bodies, self.compiled.layout.bodies, strict=True):
            q[now.iq : now.iq + 7] = self.motion.q[0, then.iq : then.iq + 7]
        return choose_static_modes(add_damping(compiled, model, q)[0], q)

    def _run(self, model: Model, name: str) -> Result:
        from flexmb.model.scenes.dynamics import ValiditySpec
        from flexmb.results import Result
        from flexmb.workflow.run import run_single

        folder, model = writable_folder(self.folder / name), copy.copy(model)
        model.set_validity(**dict.fromkeys(ValiditySpec.model_fields, "any"))  # valid or not
        _copy_bodies(self.run.path.parent, folder)
        report = run_single(model, folder, pictures=False, progress=self.progress)
        return Result(report.result)

    def _reduced(self, model: Model, effect: Effect) -> FlexBody:
        """The body of an effect reduced with its words; kept beside the result."""
        from flexmb.workflow.flexible_bodies import flexible_bodies

        own, deforms = self.run.path.parent, effect.name in (DEFORMATION, VIBRATION)
        name = (DEFORMATION if deforms else effect.name).replace(" ", "_")
        folder = writable_folder(self.folder / name)
        _copy_bodies(own, folder)
        model, only = active_model(model), [effect.body]
        bodies, _, _ = flexible_bodies(model, folder, only=only, progress=self.progress)
        if deforms:
            _copy_bodies(folder, own)  # for a next run with these effects
        return bodies[effect.body]


def _evaluations(run: Result) -> float:
    return float(run.statistics.get("residual_evaluations", 0.0))


def _copy_bodies(source: Path, folder: Path) -> None:
    """Reductions of meshes that are not there yet: nothing is reduced twice."""
    for file in source.glob("*.flexbody.h5"):
        if not (folder / file.name).exists():
            shutil.copy2(file, folder)
