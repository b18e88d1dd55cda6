"""Neighbouring models of a run: its scene with one effect more, or one less."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmb.model.body import BodySpec, FlexbodySpec
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.progress import Progress, silent

if TYPE_CHECKING:
    from flexmb.analysis.effects.contribution import Contribution
    from flexmb.analysis.effects.perturbation import Motion
    from flexmb.engine.compile import Compiled
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import OutputBlock, Result

Array = NDArray[np.float64]
Estimate = Callable[[], tuple[list["Contribution"], float | None]]

DEFORMATION = "deformation"
_EVALUATIONS = 40  # of the equations, to time them
_MORE_MODES = 2  # times as many modes tell what those left out would do


@dataclass(frozen=True)
class Effect:
    """An effect of a body, or of the scene: whether it is on, and how to estimate it."""

    name: str
    body: str
    on: bool
    indicator: str
    estimate: Estimate | None = None
    why: str = ""  # there is no estimate


@dataclass
class Neighbours:
    """A run with its model, and the models next to it."""

    run: Result
    model: Model
    bodies: Mapping[str, FlexBody]
    compiled: Compiled
    motion: Motion
    folder: Path
    progress: Progress = silent
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, run: Result, most_rows: int, progress: Progress) -> Neighbours:
        """The model of a run, and at most so many of its rows."""
        from flexmb.analysis.effects.contribution import read_motion
        from flexmb.engine.compile import compile_system
        from flexmb.model import Model
        from flexmb.workflow.resume import load_bodies

        model = Model.from_scene_dict(run.model, run.path.parent)
        bodies = load_bodies(run)
        compiled = compile_system(model, bodies)
        motion = read_motion(run).thinned(most_rows)
        return cls(run, model, bodies, compiled, motion, run.path.parent / "audit", progress)

    def rows(self) -> OutputBlock:
        """The rows as a block of outputs."""
        from flexmb.results import OutputBlock

        m, none = self.motion, np.zeros((len(self.motion.t), 0))
        return OutputBlock(m.t, m.q, m.v, m.vd, m.lam, none, m.channels, none, none)

    def effects(self) -> Iterator[Effect]:
        """All effects, body by body, then those of the scene."""
        for columns in self.compiled.layout.bodies:
            if columns.m:
                yield from self._of_body(columns.name)
        yield from self._of_scene()

    def _of_body(self, name: str) -> Iterator[Effect]:
        from flexmb.analysis.effects.indicators import indicators

        body = self.compiled.flexbodies[name]
        numbers = indicators(self.compiled, self.motion, body, name)
        bent = f"u/L {numbers.deflection:.2g}"
        yield Effect(DEFORMATION, name, True, bent, lambda: self._deformation(name))
        fast = f"f/f1 {numbers.excitation:.2g}"
        yield Effect("vibration", name, True, fast, lambda: self._deformation(name, vibration=True))
        yield self._stiffening(name, body, f"Ω/ω1 {numbers.speed:.2g}")
        yield self._modes(name, body)
        if body.D is not None and np.any(body.D):
            undamped = replace(body, D=None)
            yield Effect("damping", name, True, "", lambda: self._by(bodies={name: undamped}))

    def _stiffening(self, name: str, body: FlexBody, indicator: str) -> Effect:
        what, spec = "geometric stiffening", self.model.bodies[name]
        if body.centrifugal_stiffness is not None:
            parts = tuple(replace(part, bend=None) for part in body.interfaces)
            without = replace(body, centrifugal_stiffness=None, interfaces=parts)
            return Effect(what, name, True, indicator, lambda: self._by(bodies={name: without}))
        if not isinstance(spec, MeshBodySpec):
            why = "the body file has no data for it: reduce with geometric_stiffening = true"
            return Effect(what, name, False, indicator, None, why)
        return Effect(
            what, name, False, indicator,
            lambda: self._by(bodies={name: self._reduced(name, geometric_stiffening=True)}),
        )  # fmt: skip

    def _modes(self, name: str, body: FlexBody) -> Effect:
        spec, what = self.model.bodies[name], "further modes"
        if not isinstance(spec, MeshBodySpec) or spec.reduction in ("user", "guyan"):
            return Effect(what, name, False, f"{body.m} modes", None, "needs the mesh of the body")
        n = _MORE_MODES * max(spec.mode_count, 4)

        def estimate() -> tuple[list[Contribution], float | None]:
            finer = self._reduced(name, modes=n)
            return self._by(bodies={name: finer}, shapes={name: _shapes(body, finer)})

        return Effect(what, name, False, f"{body.m} modes", estimate)

    def _of_scene(self) -> Iterator[Effect]:
        if self.model.gravity is not None:
            model = copy.copy(self.model)
            model.gravity = None
            yield Effect("gravity", "", True, "", lambda: self._by(model=model))
        friction = [
            name for name, spec in self.model.forces.items()
            if getattr(spec, "type", "") == "joint-friction"
        ]  # fmt: skip
        if friction:
            smooth = copy.copy(self.model)
            smooth.forces = {k: v for k, v in self.model.forces.items() if k not in friction}
            yield Effect("joint friction", "", True, "", lambda: self._by(model=smooth))

    def _by(
        self, *, model: Model | None = None, bodies: Mapping[str, FlexBody] | None = None,
        shapes: Mapping[str, Array] | None = None,
    ) -> tuple[list[Contribution], float | None]:  # fmt: skip
        """Contributions to the sensors by another model along the motion of the run."""
        from flexmb.engine.compile import compile_system

        model = self.model if model is None else model
        other = compile_system(model, {**self.bodies, **(bodies or {})})
        changes = self._estimate(self.compiled, other, model, self.motion, shapes or {})
        return changes, _evaluation_time(other, self.motion) / self._own_time

    def _estimate(
        self, own: Compiled, other: Compiled, model: Model, motion: Motion,
        shapes: Mapping[str, Array], vibration: bool = False,
    ) -> list[Contribution]:  # fmt: skip
        from flexmb.analysis.effects.contribution import contributions, estimate

        begins = "from" not in self._origin
        change = estimate(own, other, model, motion, shapes, begins_as_placed=begins).channels
        if vibration:
            change = (
                change
                - estimate(
                    own, other, model, motion, shapes, begins_as_placed=begins, quasi_static=True
                ).channels
            )
        return contributions(model, motion.channels, change, other.layout.channels)

    def _deformation(
        self, name: str, vibration: bool = False
    ) -> tuple[list[Contribution], float | None]:
        """Of one body, along the motion of the scene with rigid bodies."""
        from flexmb.engine.compile import compile_system

        model, own, motion, seconds = self._rigid
        other = compile_system(_with_bodies(model, {name: self.bodies[name]}))
        changes = self._estimate(own, other, model, motion, {}, vibration)
        mine = self.run.seconds.get("integrate")
        return changes, None if vibration or not mine or not seconds else mine / seconds

    @cached_property
    def _rigid(self) -> tuple[Model, Compiled, Motion, float]:
        """The scene with rigid bodies, and its motion."""
        from flexmb.analysis.effects.contribution import read_motion
        from flexmb.engine.compile import compile_system
        from flexmb.results import Result
        from flexmb.workflow.run import run_model

        flexible = {name: rigid_twin(body) for name, body in self.bodies.items()}
        model = _with_bodies(self.model, flexible)
        report = run_model(model, self.folder / "rigid", pictures=False, progress=self.progress)
        run = Result(report.result)
        motion = read_motion(run).thinned(len(self.motion.t))
        return model, compile_system(model), motion, run.seconds.get("integrate", 0.0)

    @cached_property
    def _own_time(self) -> float:
        return _evaluation_time(self.compiled, self.motion)

    @cached_property
    def _origin(self) -> dict[str, Any]:
        from flexmb.workflow.run_report import provenance

        return provenance(self.run)

    def _reduced(self, name: str, **options: Any) -> FlexBody:
        """The body reduced from its mesh with other options; kept beside the result."""
        from flexmb.folders import writable_folder
        from flexmb.workflow.flexible_bodies import flexible_bodies

        model = copy.copy(self.model)
        spec = model.bodies[name]
        model.bodies = {**model.bodies, name: spec.model_copy(update=options)}
        folder = writable_folder(self.folder / "_".join(options))
        bodies, _, _ = flexible_bodies(model, folder, only=[name], progress=self.progress)
        return bodies[name]


def rigid_twin(body: FlexBody) -> FlexBody:
    """The body without modes, its interfaces and nodes where they are."""
    from flexmb.flexbody import FlexBody

    none = np.zeros
    interfaces = tuple(
        replace(part, Phi_t=none((3, 0)), Phi_r=none((3, 0)), bend=None) for part in body.interfaces
    )
    nodes = body.nodes
    if nodes is not None:
        modes = none((len(nodes.ids), 3, 0))
        nodes = replace(nodes, Phi_t=modes, Phi_r=None if nodes.Phi_r is None else modes)
    return FlexBody(
        body.name, body.mass, body.S1, body.S0, none((3, 0)), none((3, 3, 0)),
        none((3, 3, 0, 0)), none((0, 0)), interfaces=interfaces, nodes=nodes,
    )  # fmt: skip


def _with_bodies(model: Model, bodies: Mapping[str, FlexBody]) -> Model:
    """The model with these bodies given as objects."""
    model = copy.copy(model)
    specs = dict(model.bodies)
    for name, body in bodies.items():
        shared = {key: getattr(specs[name], key) for key in BodySpec.model_fields}
        specs[name] = FlexbodySpec.model_construct(**shared, flexbody=body)
    model.bodies = specs
    return model


def _shapes(body: FlexBody, finer: FlexBody) -> Array:
    """(m of the finer, m) modal coordinates of a finer body that each of a body's own are."""
    fields = [
        np.vstack([np.vstack([part.Phi_t, part.Phi_r]) for part in one.interfaces]
                  + ([] if one.nodes is None else [one.nodes.Phi_t.reshape(-1, one.m)]))
        for one in (finer, body)
    ]  # fmt: skip
    return np.asarray(np.linalg.lstsq(fields[0], fields[1], rcond=None)[0])


def _evaluation_time(compiled: Compiled, motion: Motion) -> float:
    """Seconds that one evaluation of the equations and their matrix takes."""
    from flexmb.analysis.effects.linearisation import Linearisation

    lin = Linearisation(compiled)
    row = lin.blank()
    best = np.inf
    for _ in range(3):
        began = time.perf_counter()
        for _ in range(_EVALUATIONS):
            lin.evaluate(row)
            lin.assemble(1.0, 1.0)
        best = min(best, time.perf_counter() - began)
    return best / _EVALUATIONS
