"""Variants of the model of a run, with one effect more or less, and their motions.

An effect is switched by options of the scene alone, so that a variant can be linearised about the
motion of the run, and can be run itself. If the rows of the run do not resolve its motion, the
scene is run again with more rows.
"""

from __future__ import annotations

import copy
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.folders import writable_folder
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.scenes.effects import active_model, with_words
from flexmb.progress import Progress, silent
from flexmb.workflow.effect import (
    DEFORMATION,
    DYNAMIC,
    FULL,
    RIGID,
    VIBRATION,
    Effect,
    body_effects,
)

if TYPE_CHECKING:
    from flexmb.analysis.effects.stored_motion import Motion
    from flexmb.engine.compile import Compiled
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.results.output_block import OutputBlock

# relative difference of velocities and accelerations between rows, above which rows are too few
_RATE_GAP = 0.2
_RINGING_SHARE = 0.0025  # share of a sensor's signal that may vibrate faster than the rows resolve
_ENOUGH_ROWS = 1.1  # rows suffice if not more than this factor of rows would be needed
_REFINEMENT = 4  # largest factor of additional rows if the rows do not resolve the motion
_MAX_ENTRIES = 1.2e7  # entries of a matrix of the coordinates in all rows: 100 MB


@dataclass
class ModelVariants:
    """A run with its model, and variants of the model.

    Attributes
    ----------
    folder : Path
        Folder of the runs and reductions that the estimates need; existing ones are reused.
    """

    run: Result
    model: Model
    bodies: Mapping[str, FlexBody]
    compiled: Compiled
    motion: Motion
    folder: Path
    progress: Progress = silent
    notes: list[str] = field(default_factory=list)
    _runs: int = 0  # number of runs with other options
    _rigid: dict[tuple[str, ...], tuple[Compiled, Motion, float]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, run: Result, most_rows: int, progress: Progress = silent, rows_before: int = 0
    ) -> ModelVariants:
        """The model of a run, and at most `most_rows` of its rows; `rows_before`: those that a
        similar run needed."""
        from flexmb.analysis.effects.stored_motion import read_motion
        from flexmb.engine.compile import compile_system
        from flexmb.flexbody import load
        from flexmb.model import Model
        from flexmb.workflow.compiled_model import damped_as_run
        from flexmb.workflow.flexible_bodies import AUDIT, SIMULATED
        from flexmb.workflow.resume import load_bodies

        model = Model.from_scene_dict(run.model, run.path.parent)
        bodies = load_bodies(run)
        folder = run.path.parent / AUDIT
        compiled = damped_as_run(compile_system(model, bodies), model, run)
        for name, file in run.flexbodies.items():
            spec = model.bodies[name]
            if isinstance(spec, MeshBodySpec) and spec.deformation == RIGID["deformation"]:
                continue  # an earlier reduction in the folder may be of another mesh
            whole = file.with_name(file.name.replace(SIMULATED, "."))
            bodies[name] = load(whole) if whole != file and whole.exists() else bodies[name]
        made = cls(run, model, bodies, compiled, read_motion(run, compiled), folder, progress)
        again = None if made.has_origin else partial(made._run, name="rows")
        made.motion, made.notes = resolved_motion(
            made.motion, compiled, model, most_rows, again, rows_before
        )
        return made

    @cached_property
    def finer(self) -> ModelVariants | None:
        """The same with up to four times as many rows; None if they are no more, or not run."""
        from flexmb.analysis.effects.stored_motion import read_motion

        few = len(self.motion.t) - 1
        n = min(_REFINEMENT * few, int(_MAX_ENTRIES / self.compiled.layout.nv**2))
        if n < 2 * few or self.has_origin or self.model.dynamics is None:
            return None
        model = copy.copy(self.model)
        model.dynamics = self.model.dynamics.model_copy(update={"outputs": n})
        try:
            motion = read_motion(self._run(model, "finer"), self.compiled)
        except FlexmbError:
            return None
        return replace(self, motion=motion, _runs=0, _rigid={})

    @property
    def turns(self) -> float:
        """Largest rotation of a body over the run [rad]."""
        t, v = self.motion.t, self.motion.v
        columns = [body.iv + 3 for body in self.compiled.layout.bodies]
        speeds = [np.linalg.norm(v[:, iv : iv + 3], axis=1) for iv in columns]
        return float(max(np.trapezoid(speed, t) for speed in speeds))

    def rows(self) -> OutputBlock:
        """The rows as a block of outputs."""
        from flexmb.results.output_block import OutputBlock

        m, none = self.motion, np.zeros((len(self.motion.t), 0))
        return OutputBlock(m.t, m.q, m.v, m.vd, m.lam, none, m.channels, none, none)

    def effects(self) -> Iterator[Effect]:
        """The effects of flexible bodies, body by body."""
        return body_effects(self.model, self.compiled, self.motion, self.bodies)

    def neighbour(self, *effects: Effect) -> Model:
        """The scene with an effect switched over, or with one effect of several bodies."""
        if effects[0].body:
            return with_words(self.model, {one.body: one.words for one in effects})
        model = copy.copy(self.model)
        stated = {} if model.effects is None else model.effects.model_dump()
        model.set_effects(**{**stated, **effects[0].words})
        return model

    @cached_property
    def static(self) -> dict[str, Any]:
        """Bodies with quasi-static modes, and their option ``deformation``."""
        from flexmb.engine.ordering import quasi_static

        bodies = self.compiled.flexbodies
        specs: Mapping[str, Any] = self.model.bodies
        return {
            k: specs[k].deformation for k in bodies if quasi_static(specs[k], bodies[k], self.model)
        }

    @cached_property
    def dynamic(self) -> tuple[Model, Compiled]:
        """The scene and its compiled system with all modes of the run dynamic."""
        model = with_words(self.model, dict.fromkeys(self.static, DYNAMIC))
        return model, self.compile(model, self.bodies) if self.static else self.compiled

    def without(self, names: tuple[str, ...]) -> tuple[Compiled, Motion, float]:
        """The scene with some bodies rigid and all modes of the others dynamic; its motion;
        seconds."""
        from flexmb.analysis.effects.contribution import evaluation_time

        if all(self.compiled.flexbodies[name].m == 0 for name in names):
            return self.dynamic[1], self.motion, 0.0
        if names not in self._rigid:
            words = dict.fromkeys(names, RIGID)
            own = self.compile(with_words(self.dynamic[0], words), self.bodies)
            motion, evaluations = self.motion_of(with_words(self.model, words), own)
            self._rigid[names] = own, motion, evaluations * evaluation_time(own)
        return self._rigid[names]

    def motion_of(self, model: Model, own: Compiled) -> tuple[Motion, float]:
        """The motion of a variant, `own` if compiled, and its number of evaluations."""
        from flexmb.analysis.effects.stored_motion import read_motion

        model, finer = copy.copy(model), {"outputs": len(self.motion.t) - 1}
        if model.dynamics is not None and self.notes:  # the rows of another run
            model.dynamics = model.dynamics.model_copy(update=finer)
        self._runs += 1
        # numbered, since names of bodies may be of any length
        run = self._run(model, f"switched_{self._runs}")
        return read_motion(run, own).thinned(len(self.motion.t)), evaluations(run)

    def deformable(
        self, effects: tuple[Effect, ...]
    ) -> tuple[Compiled, Motion, Model, dict[str, FlexBody], float]:
        """The scene with bodies rigid, its motion, the scene with them flexible, its bodies,
        seconds."""
        names, bodies = tuple(one.body for one in effects), dict(self.bodies)
        own, motion, last = self.without(names)
        model = with_words(self.dynamic[0], dict.fromkeys(names, DYNAMIC))
        for one in effects:
            name, body, spec = one.body, bodies[one.body], model.bodies[one.body]
            has_mesh = isinstance(spec, MeshBodySpec)
            has_data = body.centrifugal_stiffness is not None
            if self.compiled.flexbodies[name].m == 0 and (has_mesh or has_data):
                # a bending body becomes shorter, also in slow motion
                model = with_words(model, {name: FULL})
            full = getattr(model.bodies[name], "geometric_stiffening", None) == "full"
            if has_mesh and (body.m == 0 or (full and not has_data)):
                bodies[name] = self.reduced(model, one)
        return own, motion, model, bodies, last

    @cached_property
    def has_origin(self) -> bool:
        """Whether the run continues another one."""
        from flexmb.workflow.run_report import provenance

        return "from" in provenance(self.run)

    def compile(self, model: Model, bodies: Mapping[str, FlexBody]) -> Compiled:
        """The model with the damping of its modes as they are joined in the first row."""
        from flexmb.analysis.assembly.body_damping import add_damping
        from flexmb.analysis.assembly.static_mode_selection import choose_static_modes
        from flexmb.engine.compile import compile_system

        compiled = compile_system(model, bodies)
        (q,), (first,) = (
            one.layout.of_frames(place)
            for one, place in ((compiled, compiled.initial_q), (self.compiled, self.motion.q[0]))
        )
        for now, then in zip(compiled.layout.bodies, self.compiled.layout.bodies, strict=True):
            q[now.iq : now.iq + 7] = first[then.iq : then.iq + 7]
        (q,) = compiled.layout.of_equations(q)
        return choose_static_modes(add_damping(compiled, model, q)[0], q)

    def _run(self, model: Model, name: str) -> Result:
        from flexmb.results import Result
        from flexmb.workflow.run import run_single

        folder = writable_folder(self.folder / name)
        _copy_bodies(self.run.path.parent, folder)
        report = run_single(model, folder, pictures=False, is_judged=False, progress=self.progress)
        return Result(report.result)

    def reduced(self, model: Model, effect: Effect) -> FlexBody:
        """The body of an effect, reduced with the options of that effect; stored in `folder`."""
        from flexmb.workflow.flexible_bodies import flexible_bodies

        own, deforms = self.run.path.parent, effect.name in (DEFORMATION, VIBRATION)
        name = (DEFORMATION if deforms else effect.name).replace(" ", "_")
        folder = writable_folder(self.folder / name)
        _copy_bodies(own, folder)
        model, only = active_model(model), [effect.body]
        bodies, _, _ = flexible_bodies(model, folder, only=only, progress=self.progress)
        if deforms:
            _copy_bodies(folder, own)  # for later runs with these effects
        return bodies[effect.body]


def resolved_motion(
    motion: Motion, compiled: Compiled, model: Model, most_rows: int,
    run: Callable[[Model], Result] | None, rows_before: int = 0,
) -> tuple[Motion, list[str]]:  # fmt: skip
    """At most `most_rows` rows of a motion that resolve it, and notes on them.

    Parameters
    ----------
    motion, compiled, model
        The rows of a run, and its model.
    most_rows : int
        Up to four times as many rows are used, from another run, if these do not resolve
        accelerations, rotations and vibrations at sensors, and if the model is not too large.
    run : callable, optional
        Runs a model; None: it cannot be run again.
    rows_before : int
        Rows that a similar motion needed. If these are as many as there may be, this one is not
        tried with `most_rows` first.
    """
    from flexmb.analysis.effects.stored_motion import read_motion
    from flexmb.analysis.functions_of_time import rows_beside_brief_changes
    from flexmb.model.excitation import driving_frequencies

    rows, thinned, notes = motion, motion.thinned(most_rows), []
    fastest = max((hertz for _, hertz in driving_frequencies(model)), default=0.0)
    limits = list(_row_limits(compiled, most_rows))
    if rows_before >= limits[-1]:
        limits = limits[1:] or limits
    for most in limits:
        thinned = rows.thinned(most)
        better = max(thinned.turns(compiled, fastest), _ringing_factor(model, compiled, thinned))
        if most > most_rows and better <= _ENOUGH_ROWS and thinned.gap(compiled) <= _RATE_GAP:
            break
        finer = max(thinned.finer(compiled, fastest), better)
        wanted = int(np.ceil((len(thinned.t) - 1) * finer))
        if most < limits[-1] <= wanted and better > _ENOUGH_ROWS * (most / len(thinned.t)) ** 2:
            # vibrations decrease at best with the fourth power of the rows: more are needed
            continue
        n = min(max(wanted, rows_before - 1), most - 1)
        if finer > 1.0 and n > len(rows.t) and model.dynamics is not None and run is not None:
            n = rows_beside_brief_changes(compiled, float(motion.t[-1]), n, most - 1)
            other = copy.copy(model)
            other.dynamics = model.dynamics.model_copy(update={"outputs": n})
            try:
                rows = read_motion(run(other), compiled)
            except FlexmbError as error:  # a run with other steps may fail
                why = str(error).splitlines()[0]
                notes.append(
                    f"a run with {n + 1} rows, which would resolve the motion, fails: {why}"
                )
                break
            thinned = rows.thinned(most)
            notes = [f"{len(motion.t)} rows do not resolve the motion: audited with {n + 1}"]
    if fastest * np.diff(thinned.t).max() > 0.5:
        loads = f"{model.units.say(fastest, 'Hz', 2)} that drive the scene"
        notes.append(f"the {len(thinned.t)} rows do not see the {loads}")
    if (gap := thinned.gap(compiled)) > _RATE_GAP:
        notes.append(
            f"the {len(thinned.t)} rows resolve the accelerations of the bodies to "
            f"{100 * gap:.2g} % only: the estimates are rough"
        )
    return thinned, notes


def _ringing_factor(model: Model, compiled: Compiled, motion: Motion) -> float:
    """Factor of additional rows that would resolve the vibrations at the sensors."""
    from flexmb.analysis.effects.contribution import fast_shares, round_off

    names, least = compiled.layout.channels, round_off(compiled, motion)
    rings = fast_shares(model, motion.channels, names, least).values()
    return float(np.sqrt(max(rings, default=0.0) / _RINGING_SHARE))


def _row_limits(compiled: Compiled, most_rows: int) -> Iterator[int]:
    """Allowed numbers of rows: first `most_rows`, then more if memory allows."""
    yield most_rows
    affordable = int(_MAX_ENTRIES / compiled.layout.nv**2)
    if affordable > most_rows:
        yield from 2 * [min(affordable, _REFINEMENT * most_rows)]


def evaluations(run: Result) -> float:
    return float(run.statistics.get("residual_evaluations", 0.0))


def _copy_bodies(source: Path, folder: Path) -> None:
    """Copy reductions of meshes that the folder does not contain, so that none is repeated."""
    for file in source.glob("*.flexbody.h5"):
        if not (folder / file.name).exists():
            shutil.copy2(file, folder)
