"""Damping matrices of flexible bodies, from the damping ratios that a scene gives.

In: a compiled model and its first pose. Out: the model with the damping matrices of its bodies, and
the damping ratio of each mode. A ratio applies to the modes that a body has as part of the
mechanism (`mechanism_modes`), not to those of the free body. Quasi-static modes have no mass and
kinetostatic bodies no vibrations, so they have no damping ratio.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, one_blas_thread
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.engine.bodies.flexible_body import put_flags
from flexmb.engine.bodies.static_modes import static_bodies
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import aligned
from flexmb.errors import FlexmbError, Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array
from flexmb.flexbody.damping import DampingOptions, read_damping
from flexmb.flexbody.natural_modes import Vibrations, damping_matrix, damping_ratios
from flexmb.model.model import Model
from flexmb.results import BodyDamping


def selected_damping(model: Model, name: str, body: FlexBody) -> DampingOptions | None:
    """The damping of a flexible body: that of the scene, otherwise that of the body itself."""
    words = read_damping(getattr(model.bodies[name], "damping", None))
    return body.damping if words is None else words


@one_blas_thread()
def add_damping(compiled: Compiled, model: Model, q: Array) -> tuple[Compiled, list[BodyDamping]]:
    """The model with the damping of its flexible bodies, and the damping ratios of their modes.

    If there are several flexible bodies, the last entry, without a name, has the ratios of the
    modes of all of them together.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model, which is returned unchanged if it is damped already.
    q : (nq,) array
        First positions, which satisfy the constraints.

    Raises
    ------
    SceneError
        Modes that do not exist, cut-off frequencies below all modes.
    """
    if compiled.is_damped:
        return compiled, []
    parts = compiled.system.parts
    pool, bodies = aligned(parts.pool), parts.bodies.copy()
    flexbodies = dict(compiled.flexbodies)
    problems: list[Problem] = []
    dampings: list[BodyDamping] = []
    every, (static, kinetostatic) = list(range(len(bodies))), static_bodies(compiled.system)
    scene, others = None, ""
    for k, (row, columns) in enumerate(zip(bodies, compiled.layout.bodies, strict=True)):
        body = compiled.flexbodies.get(columns.name)
        if body is None or row["m"] == 0:
            continue
        name, m = columns.name, int(row["m"])
        if k in kinetostatic:
            dampings.append(BodyDamping(name, "none: all modes are quasi-static"))
            continue
        D = np.asarray(body.D)
        words = selected_damping(model, name, body)
        if words is None and not np.any(D):
            dampings.append(BodyDamping(name, "none"))
            continue
        if compiled.layout.nv > MAX_COORDINATES:
            scene, others = MechanismModes(compiled, q, [k]), ", all other bodies at rest"
        joined = (scene := scene or MechanismModes(compiled, q, every)).vibrations(k)
        text = "by the matrix of the body"
        if words is not None:
            text = words.sentence()
            try:
                D = damping_matrix(
                    body, words, joined, f"bodies.{name}.damping",
                    None if others else scene.part_of_modes(k),
                )  # fmt: skip
            except FlexmbError as error:
                problems += error.problems
                continue
        at = int(row["flex"]) + 12 * m + 2 * m * m
        pool[at : at + m * m] = D.ravel()
        flexbodies[name] = replace(body, D=D)
        put_flags(row, flexbodies[name], k in static)
        dampings.append(_ratios(name, text + others, D, joined))
    if problems:
        raise SceneError.from_problems(problems)
    if scene is None:
        return compiled, dampings
    if len(scene.flexible) > 1 and not others:
        names = [compiled.layout.bodies[k].name for k in scene.flexible]
        D = block_diag(*(flexbodies[name].D for name in names))
        dampings.append(_ratios("", "all flexible bodies", D, scene.together))
    system = compiled.system._replace(parts=parts._replace(pool=pool, bodies=bodies))
    return replace(compiled, system=system, flexbodies=flexbodies, is_damped=True), dampings


def _ratios(body: str, words: str, D: Array, joined: Vibrations) -> BodyDamping:
    frequencies, ratios = joined.omega / (2 * np.pi), damping_ratios(D, joined)
    return BodyDamping(body, words, tuple(frequencies.tolist()), tuple(ratios.tolist()))
