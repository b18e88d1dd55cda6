"""The mobility of a model: what `flexmb check` tells of its joints and drivers, as data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from flexmb.errors import FlexmbError, SceneError

if TYPE_CHECKING:
    from flexmb.analysis.mobility.degrees_of_freedom import Mobility
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model

__all__ = ["mobility"]


def mobility(model: Model, flexbodies: Mapping[str, FlexBody] | None = None) -> Mobility:
    """Coordinates, equations, rank, redundant equations with their cures, free motions.

    Parameters
    ----------
    model : Model
        The model; it is not changed.
    flexbodies : mapping of str to FlexBody, optional
        Reduced bodies of meshes by name; a mesh that is not given counts as a rigid body.

    Returns
    -------
    Mobility
        In the assembled pose, at t = 0.

    Raises
    ------
    SceneError
        All that does not fit together.
    AssemblyError
        It cannot be assembled, is on a wrong branch, or its drivers contradict each other or the
        joints.
    FlexmbError
        It has too many coordinates.
    """
    from flexmb.analysis.assembly.rank import MAX_COORDINATES
    from flexmb.analysis.mobility.degrees_of_freedom import mobility_of
    from flexmb.engine.compile import compile_system
    from flexmb.workflow.bodies import bodies_of_surveys, surveyed_bodies

    known = dict(flexbodies or {})
    unknown = [name for name, spec in model.bodies.items() if spec.flexible and name not in known]
    if unknown:
        surveys, problems = surveyed_bodies(model)
        if problems:
            raise SceneError.from_problems(problems)
        known = {**bodies_of_surveys(model, surveys)[0], **known}
    compiled = compile_system(model, known)
    if compiled.layout.nv > MAX_COORDINATES:
        what = f"the model has {compiled.layout.nv} coordinates; the rank of its equations is "
        raise FlexmbError(f"{what}found for up to {MAX_COORDINATES}")
    return mobility_of(compiled, model)
