"""Equilibria of a scene or model: all that can be found, one over a parameter, spring preloads.

In: a scene or a model. Out: `Equilibrium`, a `StaticSweep`, free lengths of springs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, SceneError, nearest
from flexmb.folders import output_folder
from flexmb.progress import Progress, silent
from flexmb.workflow.compiled_model import compile_source, read_values

if TYPE_CHECKING:
    from flexmb.analysis.equilibrium_search import Equilibrium
    from flexmb.analysis.static_sweep import StaticSweep
    from flexmb.model import Model

TIME = "time"
"""The parameter of a sweep over the time of functions and drivers."""


def sweep_statics(
    source: Model | str | Path | Callable[[float], Model],
    parameter: str,
    values: Sequence[float | str],
    *,
    overrides: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> StaticSweep:
    """Follow an equilibrium over values of a parameter, or of the time.

    Parameters
    ----------
    source : path, callable or Model
        A scene file, or a function that makes a model for a value; a model for `"time"`.
    parameter : str
        A parameter or knob of the scene, such as ``"load"`` or ``"forces.spring.stiffness"``;
        ``"time"``: functions and drivers have their values at these times, in the scene's units.
    values : sequence of float or str
        In the order in which they are computed; the first starts from the placed pose. Those of
        ``"time"`` may have units, ``"30 ms"``.
    overrides, progress
        As of `linearize`.

    Returns
    -------
    StaticSweep
        Equilibria, channels, stability; limit points, and values without equilibrium.

    Raises
    ------
    FlexmbError
        Whatever is wrong; no equilibrium for the first value.
    """
    from flexmb.analysis.static_sweep import SystemAt, sweep_equilibria

    if not len(values):
        raise SceneError.from_problems([Problem("values", "at least one is needed")])
    whole, names = None, None
    if parameter == TIME and not callable(source):
        whole = compile_source(source, overrides=overrides, progress=progress)
        names = whole.model.context
    numbers = read_values(values, parameter, names)

    def system_at(value: float) -> SystemAt:
        if whole is not None:
            scale = whole.model.units.scale("s")
            return SystemAt(whole.compiled, whole.model, value * scale)
        if callable(source):
            made = compile_source(source(value))
        elif isinstance(source, str | Path):
            changes = {**(overrides or {}), parameter: f"{value!r}"}
            folder = output_folder(source) / "sweep"
            made = compile_source(source, overrides=changes, output=folder)
        else:
            what = "give the scene file, or a function that makes the model for a value"
            raise SceneError(f"a model in memory has no parameter {parameter} to vary: {what}")
        return SystemAt(made.compiled, made.model)

    return sweep_equilibria(system_at, parameter, numbers, progress=progress)


def equilibria(
    source: Model | str | Path,
    *,
    time: float = 0.0,
    starts: int = 30,
    overrides: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> list[Equilibrium]:
    """Equilibria of a model that are found from many start poses, by increasing energy.

    Parameters
    ----------
    source : Model or path
        A model or a scene file (.toml).
    time : float
        Time of functions and drivers, in the scene's units.
    starts : int
        Number of start poses: the placed pose, and random ones along the free motions.
    overrides, progress
        As of `linearize`.

    Returns
    -------
    list of Equilibrium
        Stable and unstable ones, all different.

    Raises
    ------
    FlexmbError
        Whatever is wrong; no equilibrium is found from the placed pose.
    """
    from flexmb.analysis.equilibrium_search import find_equilibria

    system = compile_source(source, overrides=overrides, progress=progress)
    scaled = time * system.model.units.scale("s")
    return find_equilibria(system.compiled, system.model, time=scaled, starts=starts)


def free_lengths(
    source: Model | str | Path,
    springs: Sequence[str],
    *,
    overrides: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> dict[str, float]:
    """Free lengths of springs for which the placed pose is an equilibrium.

    Parameters
    ----------
    source : Model or path
        A model or a scene file (.toml).
    springs : sequence of str
        Linear spring-dampers whose free length may change; if there are more than needed, the sum
        of squared changes of their forces is minimal.
    overrides, progress
        As of `linearize`.

    Returns
    -------
    dict of str to float
        In the scene's units, for ``free_length``.

    Raises
    ------
    SceneError
        A name that is no linear spring-damper.
    AssemblyError
        Their forces cannot balance the pose.
    """
    from flexmb.analysis.equilibrium_search import preloads

    system = compile_source(source, overrides=overrides, progress=progress)
    tables = system.compiled.system.kinds.get("springs")
    rows = {
        path.partition(".")[2]: tables.rows[element.row]
        for path, element in system.compiled.elements.items()
        if element.kind == "springs" and tables is not None
    }
    wrong = [name for name in springs if name not in rows or not rows[name]["k"] > 0.0]
    if wrong:
        names = tuple(rows)
        what = "is no spring-damper with a stiffness"
        raise SceneError.from_problems([Problem(n, what, names, nearest(n, names)) for n in wrong])
    forces = preloads(system.compiled, system.model, springs)
    return {
        name: float(system.model.units.outward(rows[name]["d0"] + force / rows[name]["k"], "m"))
        for name, force in forces.items()
    }
