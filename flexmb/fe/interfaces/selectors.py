"""Which nodes an interface takes, from what the user says.

In: a model and the words of one interface: a group, a node, nodes, or a place and a radius. Out:
:class:`Choice`, the nodes, their reference point and how they are tied; or all that is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.meshes.centroid import group_centroid
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.tables import word_problems
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["WORDS", "Choice", "asked_nodes", "checked_words", "choose", "listed"]

WORDS = ("group", "node", "nodes", "center", "radius", "type", "weights", "position")
"""What the table of an interface may say."""

_SELECTORS = ("group", "node", "nodes", "center")
_TYPES = ("rbe2", "rbe3")
_WEIGHTS = ("uniform", "area")
_SHOWN = 8  # nodes named in a message


@dataclass(frozen=True, eq=False)
class Choice:
    """The nodes of an interface and how they are tied.

    Parameters
    ----------
    where, about : str
        For messages: the interface's place in the scene, and what was chosen.
    nodes : (k,) int
        Ascending.
    position : (3,) float
        Reference point, body frame [m].
    type : str
        ``"rbe2"`` or ``"rbe3"``.
    weights : str or (k,) float or None
        As given, those of the nodes in their order here.
    group : str or None
        The mesh group, if one was named.
    """

    where: str
    about: str
    nodes: IntArray
    position: FloatArray
    type: str
    weights: str | FloatArray | None
    group: str | None


def choose(fe: FEMatrices, where: str, given: str | Mapping[str, Any]) -> Choice:
    """Read the words of one interface.

    Raises
    ------
    MeshError
        Unknown, missing or contradicting words, no such group or node, no nodes of the body.
    """
    words = checked_words(where, given)
    about, asked = asked_nodes(fe.mesh, where, words)
    nodes = np.intersect1d(asked, fe.numbering.nodes)
    if not len(nodes):
        raise MeshError.from_problems([Problem(where, _no_nodes(fe, about, words))])
    group = words.get("group")
    if "position" in words:
        position = np.array(words["position"], dtype=float)
    elif "center" in words:
        position = np.array(words["center"], dtype=float)
    elif group is not None:
        position = group_centroid(fe.mesh, group, nodes)
    else:
        position = fe.mesh.points[nodes].mean(axis=0)
    weights = _weights(where, words.get("weights"), asked, nodes)
    return Choice(where, about, nodes, position, words.get("type", "rbe2"), weights, group)


def listed(nodes: IntArray) -> str:
    """The first few node numbers as text."""
    shown = ", ".join(str(node) for node in nodes[:_SHOWN])
    return f"{shown}, ..." if len(nodes) > _SHOWN else shown


def checked_words(where: str, given: str | Mapping[str, Any]) -> Mapping[str, Any]:
    """The words of an interface as a table.

    Raises
    ------
    MeshError
        Unknown, missing or contradicting words, and values that cannot be; all at once.
    """
    words = {"group": given} if isinstance(given, str) else given
    problems = word_problems(words, where, WORDS)
    chosen = [key for key in _SELECTORS if key in words]
    if len(chosen) != 1:
        what = f"says {' and '.join(chosen)}" if chosen else "says no nodes"
        what += "; it takes one of group, node, nodes, or center with radius"
        problems.append(Problem(where, what))
    if ("center" in words) != ("radius" in words):
        problems.append(Problem(where, "center and radius go together"))
    for key in ("center", "position"):
        if key in words and not _numbers(words[key], 3):
            what = f"must be three finite numbers [m], given {words[key]!r}"
            problems.append(Problem(f"{where}.{key}", what))
    if "radius" in words and not (_number(words["radius"]) and words["radius"] > 0):
        what = f"must be a positive number [m], given {words['radius']!r}"
        problems.append(Problem(f"{where}.radius", what))
    kind = words.get("type", "rbe2")
    if kind not in _TYPES:
        what = f"unknown type {kind!r}"
        problems.append(Problem(f"{where}.type", what, _TYPES, nearest(str(kind), _TYPES)))
    weights = words.get("weights")
    if weights is not None and kind == "rbe2":
        what = "are for rbe3 alone: nodes of an rbe2 move rigidly"
        problems.append(Problem(f"{where}.weights", what))
    elif isinstance(weights, str) and weights not in _WEIGHTS:
        what = f'unknown weights "{weights}"'
        problems.append(Problem(f"{where}.weights", what, _WEIGHTS, nearest(weights, _WEIGHTS)))
    if problems:
        raise MeshError.from_problems(problems)
    return words


def asked_nodes(mesh: Mesh, where: str, words: Mapping[str, Any]) -> tuple[str, IntArray]:
    """What the words choose, for messages, and the nodes of the mesh in the order of the words.

    Raises
    ------
    MeshError
        No such group or node.
    """
    if "group" in words:
        group = words["group"]
        return f'of the group "{group}"', mesh.group_nodes(group, where)
    if "center" in words:
        gap = np.linalg.norm(mesh.points - np.array(words["center"], dtype=float), axis=1)
        place = ", ".join(f"{value:g}" for value in words["center"])
        return f"within {words['radius']:g} m of ({place})", np.flatnonzero(gap <= words["radius"])
    key = "node" if "node" in words else "nodes"
    given = [words[key]] if key == "node" else list(words[key])
    count = len(mesh.points)
    wrong = [n for n in given if not _whole(n) or not 0 <= n < count]
    if wrong:
        what = f"{wrong[0]!r} is no node: numbers run from 0 to {count - 1}"
        raise MeshError.from_problems([Problem(f"{where}.{key}", what)])
    if len(set(given)) < len(given):
        raise MeshError.from_problems([Problem(f"{where}.{key}", "names a node twice")])
    nodes = np.array(given, dtype=np.int64)
    return f"given ({listed(nodes)})", nodes


def _no_nodes(fe: FEMatrices, about: str, words: Mapping[str, Any]) -> str:
    if "group" in words:
        return f'the group "{words["group"]}" has no nodes of the body\'s elements'
    what = f"there are no nodes of the body's elements among those {about}"
    if "center" in words:
        nodes = fe.numbering.nodes
        gap = np.linalg.norm(fe.mesh.points[nodes] - np.array(words["center"]), axis=1)
        k = int(np.argmin(gap))
        what += f"; the nearest is node {nodes[k]}, {gap[k]:.4g} m away"
    return what


def _weights(where: str, given: Any, asked: IntArray, nodes: IntArray) -> str | FloatArray | None:
    if given is None or isinstance(given, str):
        return given
    if not _numbers(given, len(asked)) or not min(given) > 0:
        what = f"must be {len(asked)} positive numbers, one for each node, given {given!r}"
        raise MeshError.from_problems([Problem(f"{where}.weights", what)])
    order = np.argsort(asked)
    found = np.array(given, dtype=float)[order]
    return found[np.isin(asked[order], nodes)]


def _number(value: Any) -> bool:
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    return real and bool(np.isfinite(value))


def _whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _numbers(given: Any, count: int) -> bool:
    if isinstance(given, str | Mapping) or not hasattr(given, "__len__"):
        return False
    return len(given) == count and all(_number(value) for value in given)
