"""What an effect contributes to the sensors of a run, along its motion or that of a neighbour.

The neighbour is linearised about that motion and driven by what the motion leaves out of balance in
it (`flexmb.analysis.effects`). Deformation is judged from a motion with rigid bodies, vibrations
from one in which the bodies follow their loads, if there is one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from flexmb.errors import FlexmbError, SolverError
from flexmb.flexbody.arrays import Array
from flexmb.model.flexible_body import stretches
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.scenes.effects import with_words
from flexmb.workflow.effect import (
    COUPLING,
    DEFORMATION,
    DYNAMIC,
    FRICTION,
    GRAVITY,
    MODES,
    OUT_OF_PLANE,
    QUASI_STATIC,
    STATIC,
    VIBRATION,
    Effect,
    more_modes,
    percent,
)
from flexmb.workflow.neighbours import ModelVariants, evaluations

if TYPE_CHECKING:
    from flexmb.analysis.effects.contribution import Contribution
    from flexmb.analysis.effects.stored_motion import Motion
    from flexmb.engine.compile import Compiled
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model

Change: TypeAlias = tuple[tuple[Array, ...], Array, tuple[str, ...], float | None]
"""Histories of the channels as in `contributions`, the change of the channels by an effect (n, k),
names of the channels, and the cost of the effect."""

# A motion of more rows than the first number is examined first by every eighth row. All rows are
# used if a sensor changes by more than _NO_CHANGE of its peak-to-peak: the selected rows have shown
# as little as 1/40 of a change.
_MIN_ROWS, _THINNING = 800, 8
_NO_CHANGE = 1e-7
# Coefficients that turn with a body are steps from row to row: they excite vibrations near a whole
# number of half periods per row. Changes above the first number (share) of runs with rotations
# above the second one [rad] are estimated with more rows, and with more again while both differ by
# more than the third number.
_DOUBTFUL, _TURN, _AGREEMENT = 0.01, 6.0, 0.3
# Effects that are told by a run where small motions tell more than this share; of bodies those that
# are on.
_RUN_ALONE = (GRAVITY, FRICTION, "contact", "stops", COUPLING, f"full {COUPLING}")
_FIRST_ORDER = 0.3
_LINEAR = "as of linear deformations, which membrane forces lessen or enlarge"
_AT_OTHER_TIMES = "contacts, stops or friction act at other times with it"


@dataclass
class Estimates:
    """Estimates of the effects of a run; changes that several of them need are computed once."""

    of: ModelVariants
    _unsettled: dict[str, str] = field(default_factory=dict)  # why, of the effect estimated last
    _unsettled_of: dict[tuple[str, ...], dict[str, str]] = field(default_factory=dict)
    _changes_of: dict[tuple[str, ...], Change] = field(default_factory=dict)

    def estimate(self, effect: Effect) -> tuple[list[Contribution], float | None]:
        """Contributions of an effect to the sensors, and its cost.

        The cost is the time of one evaluation of the equations with the effect over that without;
        for deformation, the time of all evaluations of the run over those of the rigid run.

        Raises
        ------
        FlexmbError
            The neighbour cannot be made or run.
        """
        made, cost = self._estimate(effect)
        largest = max((one.share for one in made), default=0.0)
        runs = effect.name in _RUN_ALONE and (effect.on or not effect.body)
        if runs and largest > _FIRST_ORDER and not self.of.has_origin:
            with suppress(FlexmbError):  # without it there may be no motion
                pairs = zip(made, self._switched(effect), strict=True)
                return [run if run.share else one for one, run in pairs], cost
        large = largest > _DOUBTFUL
        turning = effect.name not in (DEFORMATION, VIBRATION) and self.of.turns > _TURN
        return self._settle(effect, made) if large and turning else made, cost

    def _switched(self, effect: Effect) -> list[Contribution]:
        """Contributions by a run with an effect switched over; zero for what rests in both."""
        from flexmb.analysis.effects.contribution import contributions, round_off

        model, now = self.of.neighbour(effect), self.of.motion
        motion = self.of.motion_of(model, own := self.of.compile(model, self.of.bodies))[0]
        if not np.array_equal(now.t, motion.t):
            raise SolverError("the run without the effect has other rows")
        histories, least = (now.channels, motion.channels), round_off(self.of.compiled, now)
        change = motion.channels - now.channels
        return contributions(model, histories, change, own.layout.channels, None, least)

    def _settle(self, effect: Effect, made: list[Contribution]) -> list[Contribution]:
        """Contributions with more rows, until these do not matter or there can be no more."""
        finer = self._finer
        if finer is None:
            return made
        try:
            more = finer._estimate(effect)[0]
        except FlexmbError:
            return made
        pairs = list(zip(made, more, strict=True))
        if not any(_differ(*pair) for pair in pairs):
            return more
        if finer._finer is not None:
            return finer._settle(effect, more)
        rows = len(self.of.motion.t), len(finer.of.motion.t)
        return [_open(rows, *pair) if _differ(*pair) else pair[1] for pair in pairs]

    @cached_property
    def _finer(self) -> Estimates | None:
        """Estimates with more rows."""
        return None if self.of.finer is None else Estimates(self.of.finer)

    def _estimate(self, effect: Effect) -> tuple[list[Contribution], float | None]:
        from flexmb.analysis.effects.contribution import shared

        alike, cost, made = self._alike(effect), self._change(effect)[3], self._alone(effect)
        if len(alike) > 1 and not effect.on and effect.name != MODES:
            with suppress(FlexmbError):  # without them all there may be no motion
                return shared(made, self._each(alike), self._alone(*alike)), cost
        if effect.body and len(alike) > 1 and any(one.at_rest and one.share for one in made):
            made = self._each(alike)[[one.body for one in alike].index(effect.body)]
        return made, cost

    def _each(self, effects: Sequence[Effect]) -> list[list[Contribution]]:
        """Contributions of each effect, with the sum of the changes of all of them known."""
        with np.errstate(invalid="ignore"):  # of what is unbounded
            together = np.sum([self._change(one)[1] for one in effects], axis=0)
        return [self._alone(one, together=together) for one in effects]

    def _alone(self, *effects: Effect, together: Array | None = None) -> list[Contribution]:
        """Contributions of one effect, or of several of one kind that are switched together."""
        from flexmb.analysis.effects.contribution import contributions, round_off

        least = round_off(self.of.compiled, self.of.motion)
        made = contributions(self.of.model, *self._change(*effects)[:3], together, least)
        rough = self._unsettled_of[effects[0].name, *(one.body for one in effects)]
        return [replace(one, unsettled=rough.get(one.sensor, "")) for one in made]

    @cached_property
    def _estimable(self) -> list[Effect]:
        return [effect for effect in self.of.effects() if not effect.why]

    def _alike(self, effect: Effect) -> list[Effect]:
        """All effects of the same kind that are on or off like this one, itself included.

        Effects of rigid and of flexible bodies are kept apart.
        """
        kind, rigid = (effect.name, effect.on), effect.indicator == "rigid"
        alike = [one for one in self._estimable if (one.name, one.on) == kind]
        return [one for one in alike if (one.indicator == "rigid") == rigid]

    def _change(self, *effects: Effect) -> Change:
        """Change by one effect, or by several of one kind together."""
        name = effects[0].name
        key = (name, *(one.body for one in effects))
        if key not in self._changes_of:
            deforms = name in (DEFORMATION, VIBRATION)
            find = self._deformation if deforms else self._switch_change
            self._unsettled = {}
            self._changes_of[key] = find(*effects)
            self._unsettled_of[key] = self._unsettled
        return self._changes_of[key]

    def _switch_change(self, *effects: Effect) -> Change:
        """Change by any effect but deformation, along the motion of the run.

        Quasi-static modes of the run are in equilibrium with their loads in the change as well.
        """
        from flexmb.analysis.effects.contribution import evaluation_time as time
        from flexmb.analysis.effects.stored_motion import shapes_of

        model, own = self.of.neighbour(*effects), self.of.compiled
        follow: tuple[str, ...] = ()
        name, on, motion = effects[0].name, effects[0].on, self.of.motion
        if name != STATIC and self.of.static:
            own, static = self.of.dynamic[1], self.of.static.items()
            follow = tuple(body for body, word in static if word == "quasi-static")
            model = with_words(model, dict.fromkeys(self.of.static, DYNAMIC))
        bodies, shapes = dict(self.of.bodies), {}
        for one in effects:
            if one.body and (name == MODES or one.words.get("geometric_stiffening")):
                bodies[one.body] = self.of.reduced(model, one)
        if name == OUT_OF_PLANE:
            for body, spec in model.bodies.items():
                if isinstance(spec, MeshBodySpec):  # in the plane as many modes as the run has
                    words = more_modes(self.of.bodies[body], spec.mode_count)
                    model = with_words(model, {body: words})
                    bodies[body] = self.of.reduced(model, replace(effects[0], body=body))
            with suppress(FlexmbError):  # modes that mix both: those of the run have to do
                own, motion = self._in_plane(own, bodies)
        other = self.of.compile(model, bodies)
        finer = {OUT_OF_PLANE: own.flexbodies, MODES: [one.body for one in effects]}
        for body in finer.get(name, ()):
            shapes[body] = shapes_of(own.flexbodies[body], other.flexbodies[body])
        changes = self._few_changes(own, other, model, motion, shapes, follow)
        changes = changes or self._changes(own, other, model, motion, shapes, follow)
        times = time(other), time(own) if self.of.static else self._own_time
        return *changes, times[1] / times[0] if on else times[0] / times[1]

    def _in_plane(self, own: Compiled, spatial: Mapping[str, FlexBody]) -> tuple[Compiled, Motion]:
        """The planar model with the in-plane modes of spatial bodies, and the run in these modes.

        They differ a little from the modes of the run. Compared with the spatial model, that
        difference would count as motion out of the plane.
        """
        from flexmb.analysis.effects.stored_motion import carry_motion, shapes_of

        model = self.of.dynamic[0] if self.of.static else self.of.model
        flat = self.of.compile(model, spatial)
        shapes = {k: shapes_of(body, flat.flexbodies[k]) for k, body in own.flexbodies.items()}
        motion, _ = carry_motion(self.of.motion, own, flat, shapes)
        return flat, motion.with_channels(flat)

    def _deformation(self, *effects: Effect) -> Change:
        """Change by deformation of bodies, or by its vibration.

        Deformation is estimated along the motion with rigid bodies. Vibration is estimated along
        the motion with quasi-static bodies, if there is one; else it is the deformation less its
        quasi-static part. Next to dynamic modes both are computed: either may show vibrations that
        are not there, so that the smaller one counts.
        """
        from flexmb.analysis.effects.contribution import smaller_change, smaller_range
        from flexmb.engine.bodies.static_modes import static_coordinates

        mine = [one.body for one in effects]
        vibration = None
        if effects[0].name == VIBRATION and all(self.of.compiled.flexbodies[k].m for k in mine):
            with suppress(FlexmbError):  # of a run of its own
                vibration, alone = self._vibration(effects[0].on, mine)
                if vibration is not None and alone:
                    return vibration
        own, motion, model, bodies, last = self.of.deformable(effects)
        other = self.of.compile(model, bodies)
        if effects[0].name == DEFORMATION:
            cost, now = self.run_time / last if last else None, self.of.motion
            hardens = any(stretches(model.bodies[name]) for name in mine)
            if hardens and motion is not now and np.array_equal(now.t, motion.t):
                # small motions about the rigid one have no membrane forces: both runs tell
                change = now.channels - motion.channels
                return (now.channels, motion.channels), change, own.layout.channels, cost
            histories, change, names = self._changes(own, other, model, motion, {})
            if hardens:
                self._unsettled = {name.split(".")[0]: _LINEAR for name in names} | self._unsettled
            return (now.channels, *histories), change, names, cost
        deformations = (replace(one, name=DEFORMATION) for one in effects)
        histories, change, names, _ = self._change(*deformations)
        both = (
            with_words(one, dict.fromkeys(mine, QUASI_STATIC)) for one in (self.of.model, model)
        )
        beside, slow = (self.of.compile(one, bodies) for one in both)
        follow: tuple[str, ...] = ()
        if len(static_coordinates(beside.system, kinetostatic=True)) > 0:
            # nothing vibrates, nor do other bodies on the compliance of this one
            follow, slow = tuple(other.flexbodies), other
        (_, after), still, _ = self._changes(own, slow, model, motion, {}, follow)
        if motion is not self.of.motion:  # the body is flexible in both
            without = after if effects[0].on else smaller_range(after, histories[0])
            histories = histories[0], without, histories[2]
        change = np.where(np.isfinite(change), change - still, change)
        if vibration is not None:
            change = smaller_change(change, vibration[1])
        return histories, change, names, None

    def _vibration(self, on: bool, mine: list[str]) -> tuple[Change | None, bool]:
        """Change by vibration of bodies along the motion in which they are quasi-static; whether it
        counts alone.

        The residual of that motion at their modes excites it. None if bodies that vibrate have no
        such motion: in a frame at an interface. Next to dynamic modes, fast vibrations of these
        excite it too, which rows resolve less.
        """
        from flexmb.engine.bodies.static_modes import static_bodies

        words, specs = dict.fromkeys(mine, QUASI_STATIC), cast("Any", self.of.model.bodies)
        slow = with_words(self.of.model, words)
        now = self.of.compile(slow, self.of.bodies)
        framed = any(specs[name].frame_interface is not None for name in mine)
        if on and framed:
            return None, True
        motion = self.of.motion_of(slow, now)[0] if on else self.of.motion
        model = with_words(self.of.model, dict.fromkeys(mine, DYNAMIC))
        other = self.of.compile(model, self.of.bodies)
        histories, change, names = self._changes(now, other, model, motion, {}, inertia=mine)
        if on:
            histories = self.of.motion.channels, *histories
        alone = not on or len(static_bodies(now.system)[1]) > 0
        return (histories, change, names, None), alone

    def _changes(
        self, own: Compiled, other: Compiled, model: Model, motion: Motion,
        shapes: Mapping[str, Array], follow: Sequence[str] = (), inertia: Sequence[str] = (),
    ) -> tuple[tuple[Array, ...], Array, tuple[str, ...]]:  # fmt: skip
        """Histories of the channels with and without another model, their change, their names."""
        from flexmb.analysis.effects.contribution import estimate

        made, settled = estimate(
            own, other, model, motion, shapes,
            begins_as_placed=not self.of.has_origin, quasi_static=follow, inertia=inertia,
        )  # fmt: skip
        change, channels = made.channels, np.array(other.layout.channels)
        rough = {str(channel).split(".")[0] for channel in channels[~settled]}
        self._unsettled = {**self._unsettled, **dict.fromkeys(rough, _AT_OTHER_TIMES)}
        after = motion.channels + np.where(np.isfinite(change), change, 0.0)
        return (motion.channels, after), change, other.layout.channels

    def _few_changes(
        self, own: Compiled, other: Compiled, model: Model, motion: Motion,
        shapes: Mapping[str, Array], follow: Sequence[str],
    ) -> tuple[tuple[Array, ...], Array, tuple[str, ...]] | None:  # fmt: skip
        """`_changes` from a part of many rows if no sensor changes in these; else None."""
        from flexmb.analysis.effects.contribution import contributions

        n = len(motion.t)
        if n <= _MIN_ROWS:
            return None
        few = motion.thinned(n // _THINNING)
        histories, change, names = self._changes(own, other, model, few, shapes, follow)
        if any(one.share > _NO_CHANGE for one in contributions(model, histories, change, names)):
            return None
        every = -(-n // len(few.t))
        return 2 * (motion.channels,), np.repeat(change, every, axis=0)[:n], names

    @property
    def run_time(self) -> float:
        """Time of all evaluations of the equations of the run [s]."""
        return evaluations(self.of.run) * self._own_time

    @cached_property
    def _own_time(self) -> float:
        from flexmb.analysis.effects.contribution import evaluation_time

        return evaluation_time(self.of.compiled)


def _differ(few: Contribution, fine: Contribution) -> bool:
    """Whether two numbers of rows tell different contributions to a sensor, one of them large."""
    largest = max(few.share, fine.share)
    return largest > _DOUBTFUL and abs(few.share - fine.share) > _AGREEMENT * largest


def _open(rows: tuple[int, int], few: Contribution, fine: Contribution) -> Contribution:
    """The finer of two contributions that differ, which says so."""
    shares = percent(few.share), percent(fine.share)
    why = f"{shares[0]} of {fine.sensor} with {rows[0]} rows, {shares[1]} with {rows[1]}"
    return replace(fine, unsettled=why, coarse=few.share)
