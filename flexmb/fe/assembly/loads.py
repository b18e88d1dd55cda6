"""Loads on a model: from what the user says to a vector over its degrees of freedom.

In: a model and, by name, a table of words: a pressure or traction on a surface, a force along
lines, a force and moment on nodes, the weight in a field of gravity. Out: :class:`LoadPattern`,
work-equivalent nodal loads with their resultant. Facets are integrated with their own shape
functions; forces on groups spread as those of a weighted interface. Source: Zienkiewicz, Taylor,
The Finite Element Method, vol. 1 (consistent loads).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem, ReductionError, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.rigid_links import spread
from flexmb.fe.assembly.surface_loads import (
    condensed_load,
    line_load,
    pressure_load,
    traction_load,
)
from flexmb.fe.interfaces.make import make_interface
from flexmb.fe.interfaces.selectors import WORDS, choose
from flexmb.fe.tables import word_problems
from flexmb.flexbody.arrays import FloatArray

__all__ = ["LoadPattern", "make_loads"]

_ROUNDING = 1e-13  # of the sum of all parts: a resultant below that is none
_NODES = tuple(word for word in WORDS if word != "type")


@dataclass(frozen=True, eq=False)
class LoadPattern:
    """Nodal loads on a body.

    Parameters
    ----------
    name : str
        Name of the load.
    f : (n,) float
        Loads over the degrees of freedom [N, N m].
    force, moment : (3,) float
        Resultant, and its moment about the origin of the body frame [N, N m].
    residual : bool
        Whether the reduced basis shall hold its static response.
    """

    name: str
    f: FloatArray
    force: FloatArray
    moment: FloatArray
    residual: bool = True


def make_loads(fe: FEMatrices, given: Mapping[str, Mapping[str, Any]]) -> tuple[LoadPattern, ...]:
    """Nodal loads from what is said of each.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    given : mapping of str to mapping
        By name, in SI and body axes: ``{type = "pressure", group, pressure}`` [Pa], pushing on
        solids and along the normal of shells; ``{type = "traction", group, traction}`` [Pa] (3,);
        ``{type = "line", group, force}`` [N/m] (3,); ``{type = "force", force, moment}`` [N, N m]
        (3,) each on nodes chosen as for an interface; ``{type = "gravity", acceleration}``
        [m/s^2] (3,). ``residual`` says whether the basis holds the static response: true by
        default, false for gravity, which does not deform a free body.

    Raises
    ------
    ReductionError
        All unknown words and types, missing values, groups without facets.
    """
    found, problems = [], []
    for name, words in given.items():
        try:
            found.append(_make(fe, name, words))
        except (MeshError, ReductionError) as error:
            problems += error.problems
    if problems:
        raise ReductionError.from_problems(problems)
    return tuple(found)


def _make(fe: FEMatrices, name: str, words: Mapping[str, Any]) -> LoadPattern:
    where = f"loads.{name}"
    kind = words.get("type")
    if kind not in _LOADS:
        names = tuple(_LOADS)
        what = "says no type" if kind is None else f"unknown type {kind!r}"
        near = nearest(str(kind), names)
        raise ReductionError.from_problems([Problem(f"{where}.type", what, names, near)])
    build, needed, others = _LOADS[kind]
    allowed = ("type", "residual", *needed, *others)
    problems = word_problems(words, where, allowed, needed)
    residual = words.get("residual", kind != "gravity")
    if not isinstance(residual, bool):
        problems.append(Problem(f"{where}.residual", f"must be true or false, given {residual!r}"))
    if problems:
        raise ReductionError.from_problems(problems)
    f = build(fe, where, words)
    R = fe.rigid
    total = R.T @ f
    parts = (np.abs(R.T) @ np.abs(f)).reshape(2, 3).max(axis=1)
    total[np.abs(total) <= _ROUNDING * np.repeat(parts, 3)] = 0.0
    force = total[:3]
    moment = total[3:] + np.cross(fe.center, force)
    return LoadPattern(name, f, force, moment, residual)


def _pressure(fe: FEMatrices, where: str, words: Mapping[str, Any]) -> FloatArray:
    value = words["pressure"]
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        what = f"must be a number [Pa], given {value!r}"
        raise ReductionError.from_problems([Problem(f"{where}.pressure", what)])
    return pressure_load(fe, where, words["group"], float(value))


def _traction(fe: FEMatrices, where: str, words: Mapping[str, Any]) -> FloatArray:
    return traction_load(fe, where, words["group"], _vector(where, words, "traction"))


def _line(fe: FEMatrices, where: str, words: Mapping[str, Any]) -> FloatArray:
    return line_load(fe, where, words["group"], _vector(where, words, "force"))


def _gravity(fe: FEMatrices, where: str, words: Mapping[str, Any]) -> FloatArray:
    return np.asarray(fe.M @ (fe.rigid[:, :3] @ _vector(where, words, "acceleration")))


def _force(fe: FEMatrices, where: str, words: Mapping[str, Any]) -> FloatArray:
    if "force" not in words and "moment" not in words:
        raise ReductionError.from_problems([Problem(where, "says neither force nor moment")])
    zero = np.zeros(3)
    force = _vector(where, words, "force") if "force" in words else zero
    moment = _vector(where, words, "moment") if "moment" in words else zero
    selected = {key: words[key] for key in _NODES if key in words} | {"type": "rbe3"}
    choice = choose(fe, where, selected)
    f = np.zeros(fe.numbering.n_all)
    turning = np.isin(choice.nodes, fe.numbering.rotating).any()
    if moment.any() or turning or spread(fe.mesh.points[choice.nodes]):
        dofs, values = make_interface(fe, "", selected, where).loads()
        np.add.at(f, dofs, values @ np.concatenate([force, moment]))
    else:  # nodes that carry no moment share the force
        weights = choice.weights
        share = np.ones(len(choice.nodes)) if not isinstance(weights, np.ndarray) else weights
        dofs = fe.numbering.table[choice.nodes, :3]
        np.add.at(f, dofs, np.outer(share / share.sum(), force))
    return condensed_load(fe, f)


def _vector(where: str, words: Mapping[str, Any], key: str) -> FloatArray:
    try:
        value = np.array(words[key], dtype=float)
    except (TypeError, ValueError):
        value = np.zeros(0)
    if value.shape != (3,) or not np.isfinite(value).all():
        what = f"must be three finite numbers, given {words[key]!r}"
        raise ReductionError.from_problems([Problem(f"{where}.{key}", what)])
    return value


_Build = Callable[[FEMatrices, str, Mapping[str, Any]], FloatArray]
_LOADS: dict[str, tuple[_Build, tuple[str, ...], tuple[str, ...]]] = {
    "pressure": (_pressure, ("group", "pressure"), ()),
    "traction": (_traction, ("group", "traction"), ()),
    "line": (_line, ("group", "force"), ()),
    "force": (_force, (), ("force", "moment", *_NODES)),
    "gravity": (_gravity, ("acceleration",), ()),
}
