"""Effects of flexible bodies that a run includes, and bodies that are already reduced.

In: words of a scene. Out: checked words, or the ``FlexBody`` itself if a model is built in Python.
The effects are described in :mod:`flexmb.flexbody.effects` and :mod:`flexmb.engine.bodies`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import ValidationInfo, model_validator

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.flexbody.mesh_options import STIFFENINGS
from flexmb.model.body import BodySpec
from flexmb.model.option_specs import DampingField
from flexmb.model.quantities import Integer, Quantity
from flexmb.model.reading import (
    FieldType,
    Form,
    Reader,
    Spec,
    choice,
    context_of,
    fail,
    only_one,
    quote,
    read_entry,
    reference,
)

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody

_Modes = tuple[Annotated[int, Integer(0)], ...]
_Frequency = Annotated[float, Quantity("Hz", "not negative")]


class DeformationSpec(Spec):
    """How each mode of a flexible body deforms it.

    ``dynamic`` or ``quasi_static`` lists modes by their number, from 0, as in the table of the
    reduction: modes with inertia, or modes that follow the present loads statically. ``band`` [Hz]:
    modes of the free body with frequencies within it are dynamic. All other modes are of the other
    kind.
    """

    dynamic: _Modes | None = None
    quasi_static: _Modes | None = None
    band: tuple[_Frequency, _Frequency] | None = None

    @model_validator(mode="after")
    def _check_selection(self) -> Self:
        only_one(self, "dynamic", "quasi_static", "band")
        if self.band is not None and not self.band[0] < self.band[1]:
            raise fail(Problem("band", "must be two frequencies, the lower one first"))
        return self


DEFORMATIONS = ("rigid", "quasi-static", "dynamic", "automatic")
COUPLINGS = ("constant", "partial", "full")
MEAN_AXIS = "mean axis"
_INTERFACE = "interface "
# stiffness over that of the stiffest mode, below which a mode has no stiffness
_NO_STIFFNESS = 1e-12


class _Deformation(FieldType):
    """Annotation of a word, or of a table of modes."""

    def read(self, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, str):
            return choose(value, DEFORMATIONS, ("a table of modes",))
        spec, problems = read_entry(DeformationSpec, value, context_of(info))
        if spec is None:
            raise fail(*problems)
        return spec

    def write(self, value: Any, info: Any) -> Any:
        if isinstance(value, str):
            return value
        return value.model_dump(mode="json", exclude_none=True, context=info.context)

    def form(self, source: Any, form_of: Any) -> Form:
        return {"anyOf": [{"enum": list(DEFORMATIONS)}, reference(DeformationSpec)]}


def choose(value: Any, words: tuple[str, ...], others: tuple[str, ...] = ()) -> str:
    """The allowed word that a value names; else raises the problem."""
    if value not in words:
        near = nearest(str(value), words)
        raise fail(Problem("", f"unknown choice {quote(value)}", (*words, *others), near))
    return str(value)


def _stiffening(value: Any, info: ValidationInfo) -> str:
    if isinstance(value, bool):
        word = "full" if value else "none"
        what = f'{quote(value)} has become a word: write geometric_stiffening = "{word}"'
        raise fail(Problem("", what, STIFFENINGS))
    return choose(value, STIFFENINGS)


def _frame(value: Any, info: ValidationInfo) -> str:
    if isinstance(value, str) and value.startswith(_INTERFACE) and value[len(_INTERFACE) :].strip():
        return _INTERFACE + value[len(_INTERFACE) :].strip()
    return choose(value, (MEAN_AXIS,), ("interface NAME",))


Stiffening = Annotated[str, Reader(_stiffening, form=choice(STIFFENINGS))]


EFFECT_WORDS = {
    "deformation", "inertia_coupling", "geometric_stiffening", "membrane_forces", "frame",
}  # fmt: skip


class FlexibleBodySpec(BodySpec):
    """Options of all flexible bodies: which effects of their deformation a run includes.

    `damping` is a damping ratio of all modes with the joints of the scene, the preset "adams", or a
    table; by default that of the body's file, or none.
    """

    deformation: Annotated[Any, _Deformation()] = "dynamic"
    inertia_coupling: Literal["constant", "partial", "full"] = "full"
    geometric_stiffening: Stiffening | None = None
    membrane_forces: Literal["none", "full"] = "none"
    frame: Annotated[str, Reader(_frame, form=choice((MEAN_AXIS, "interface NAME")))] = MEAN_AXIS
    damping: DampingField | None = None

    @property
    def frame_interface(self) -> str | None:
        """Name of the interface that the body frame is fixed at; None: mean axes."""
        return self.frame[len(_INTERFACE) :] if self.frame.startswith(_INTERFACE) else None

    def frame_problems(self, interfaces: Sequence[str]) -> list[Problem]:
        """The problem of a frame at an interface that does not exist."""
        name = self.frame_interface
        if name is None or name in interfaces or self.deformation == "rigid":
            return []
        what = f'the body has no interface "{name}"'
        return [Problem("frame", what, tuple(interfaces), nearest(name, interfaces))]

    def mode_problems(self, m: int, bound: str = "") -> list[Problem]:
        """What is wrong with the numbers of `deformation`, of a body with m modes.

        `bound` is "at most " if it may have fewer.
        """
        problems = []
        for word in ("dynamic", "quasi_static"):
            wrong = [k for k in getattr(self.deformation, word, None) or () if k >= m]
            if wrong:
                what = (
                    f"the body has no mode {wrong[0]}: they are numbered from 0 to {bound}{m - 1}"
                )
                problems.append(Problem(f"deformation.{word}", what))
        return problems

    def simulated(self, body: FlexBody) -> FlexBody:
        """A reduced body as a run uses it: with the requested effects and frame.

        Raises
        ------
        ReductionError
            The body has no data for an effect, or no such modes or interface.
        """
        from flexmb.flexbody import effects

        if self.deformation == "rigid":
            return effects.rigid_twin(body)
        problems = self.frame_problems([part.name for part in body.interfaces])
        stiffened = body.centrifugal_stiffness is not None
        if self.geometric_stiffening == "full" and body.m and not stiffened:
            what = "the body has no data for it: reduce its mesh with geometric_stiffening = "
            what += '"full" (flexmb reduce --geometric-stiffening full)'
            problems.append(Problem("geometric_stiffening", what))
        membrane = body.membrane_stiffness
        has_shapes = membrane is not None and len(membrane.shapes) > 0
        if self.membrane_forces == "full" and body.m and not has_shapes:
            what = "the body has no data for them: plates, shells and solids of such shapes have, "
            what += "with interfaces, in space, reduced from a mesh"
            problems.append(Problem("membrane_forces", what))
        shortens = stiffened and self.geometric_stiffening != "none"
        if stretches(self) and self.frame_interface is not None and body.m and not shortens:
            what = 'at an interface membrane forces need geometric_stiffening = "full", by which '
            problems.append(Problem("frame", what + "a body shortens as its frame turns"))
        if effects.is_divided(body) and not (stretches(self) and shortens):
            what = "the body is as a run with membrane forces and geometric stiffening used it: "
            problems.append(Problem("flexbody", what + "take the file of its reduction"))
        problems += self.mode_problems(body.m) if body.m else []  # none: it is not reduced yet
        stiffness = np.diag(body.K)
        for k in () if problems else self.static_modes(body):
            if stiffness[k] <= _NO_STIFFNESS * stiffness.max():
                what = f"mode {k} of the body has no stiffness, so it cannot follow loads: make it "
                problems.append(Problem("deformation", what + "dynamic"))
        if problems:
            raise ReductionError.from_problems(problems)
        if stiffened and self.geometric_stiffening == "none":
            body = effects.without_stiffening(body)
        elif stretches(self):
            body = effects.with_stretching(body)
        name = self.frame_interface
        return body if name is None else effects.frame_at_interface(body, name)

    def effects_in_words(self, body: FlexBody | None = None, cutoff: float = math.inf) -> str:
        """The effects that a run includes, in words; with mode numbers once the body is reduced."""
        if self.deformation == "rigid":
            return "none: rigid"
        plain = self.deformation in ("dynamic", "quasi-static")
        parts = [f"{self.deformation if plain else 'dynamic and quasi-static'} modes"]
        stiffened = self.geometric_stiffening == "full"
        if body is not None:
            count = body.m - len(self.static_modes(body, cutoff))
            words = "the others quasi-static" if count < body.m else "none quasi-static"
            parts = [f"{count} of {body.m} modes dynamic, {words}"]
            if self.deformation == "automatic":
                parts[0] += f" (cut-off at {cutoff:.4g} Hz)"
            if isinstance(self.deformation, DeformationSpec) and self.deformation.band:
                low, high = self.deformation.band
                parts[0] += f" (band {low:g} to {high:.4g} Hz)"
            stiffened = body.centrifugal_stiffness is not None
        parts += [f"{self.inertia_coupling} coupling"]
        parts += ["geometric stiffening"] if stiffened else ["no geometric stiffening"]
        parts += ["membrane forces"] if self.membrane_forces == "full" else []
        parts += [] if self.frame == MEAN_AXIS else [f"frame at {self.frame}"]
        if self.frame != MEAN_AXIS and self.deformation == "quasi-static":
            parts[-1] += " (where loads jump or bend momentum is lost in it; mean axes keep it)"
        elif self.frame != MEAN_AXIS and self.inertia_coupling != "full":
            word = self.inertia_coupling
            parts[-1] += (
                f" (with {word} coupling it may diverge; full coupling and mean axes do not)"
            )
        named = {"inertia_coupling", "geometric_stiffening"} & self.model_fields_set
        has_modes = body is None or body.m > 0
        if named and has_modes and not stiffened and self.inertia_coupling != "constant":
            parts[-1] += " (the inconsistent set: rotation softens, but does not stiffen)"
        return ", ".join(parts)

    def static_modes(self, body: FlexBody, cutoff: float = math.inf) -> tuple[int, ...]:
        """Numbers of the quasi-static modes; with "automatic" those above the cutoff frequency
        [Hz]."""
        words, every = self.deformation, range(body.m)
        if words in ("dynamic", "rigid"):
            return ()
        if words == "quasi-static":
            return tuple(every)
        low, high = 0.0, cutoff
        if isinstance(words, DeformationSpec):
            if words.quasi_static is not None:
                return tuple(k for k in every if k in words.quasi_static)
            if words.dynamic is not None:
                return tuple(k for k in every if k not in words.dynamic)
            assert words.band is not None  # exactly one of the three is given
            low, high = words.band
        square = np.diag(body.K) / np.diag(body.M_eta)
        hertz = np.sqrt(square.clip(0.0)) / (2.0 * math.pi)
        stiff = square > _NO_STIFFNESS * square.max(initial=0.0)
        return tuple(k for k in every if stiff[k] and not low <= hertz[k] <= high)


def stretches(spec: object) -> bool:
    """Whether a run includes the membrane forces of a body."""
    if not isinstance(spec, FlexibleBodySpec) or spec.deformation == "rigid":
        return False
    return spec.membrane_forces == "full"


def _read_source(value: Any, info: ValidationInfo) -> Any:
    from flexmb.flexbody import FlexBody

    if isinstance(value, FlexBody):
        return value
    if isinstance(value, str | Path) and str(value).isprintable() and str(value).strip():
        return Path(value).as_posix()
    raise fail(Problem("", f"a flexible-body file is expected, given {quote(value)}"))


FlexibleSource = Annotated[Any, Reader(_read_source, form={"type": "string"})]
"""Path of a flexible-body file, or a FlexBody."""


class FlexbodySpec(FlexibleBodySpec):
    """A flexible body that is already reduced: its file, or the object itself.

    ``geometric_stiffening`` is by default ``"full"`` if the file has the data, else ``"none"``.
    """

    flexbody: FlexibleSource
