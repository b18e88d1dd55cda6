"""Linearised modes of a model: about its first state, an equilibrium, a time of a run.

In: a scene, a model or a result. Out: a `Linearization`, or a `ModeSweep` over a parameter, for
Campbell diagrams and root loci; pictures of the machine displaced by each mode, and the result
files of these pictures, whose rows are one period of the vibration.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import FlexmbWarning, Problem, SceneError, nearest
from flexmb.folders import writable_folder
from flexmb.model.scenes.parameters import Time
from flexmb.progress import Progress, silent
from flexmb.workflow.compiled_model import CompiledModel, compile_source, read_values
from flexmb.workflow.flexible_bodies import REUSED
from flexmb.workflow.run_report import CheckOutcome

if TYPE_CHECKING:
    from flexmb.analysis.assembly.initial_state import Assembled
    from flexmb.analysis.equilibrium_search import Equilibrium
    from flexmb.analysis.linear.linearization import Linearization, ModeSweep
    from flexmb.model import Model
    from flexmb.results import Result


STARTS = ("quasi-static", "undeformed", "static", "initial")
"""States of a scene about which it can be linearised."""


_AMPLITUDE = 0.12  # largest displacement in pictures, as a fraction of the model's size, or in rad
_PHASES = 24  # rows of one period
_GHOSTS = 3  # faint poses at equal phases: the middle one is opposite to the pose of the picture


def linearize(
    source: Model | Result | str | Path,
    *,
    time: Time | None = None,
    about: str = "quasi-static",
    frame: str = "auto",
    overrides: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> Linearization:
    """Linearise the equations of motion about a state.

    Parameters
    ----------
    source : Model, Result or path
        A model, a scene file (.toml), a result or its folder.
    time : float or str, optional
        Of a result: the output nearest to it, in the scene's units or with its own, ``"30 ms"``;
        its end by default.
    about : str
        Of a model or a scene: its first state, flexible bodies in elastic equilibrium with loads
        and motion (``"quasi-static"``), straight (``"undeformed"``), or as ``dynamics.start`` says
        (``"initial"``); or the equilibrium of the whole machine at rest (``"static"``).
    frame : str
        The axes in which the motion is written: ``"ground"``, a rotating body, or ``"auto"``: those
        in which the coefficients change least.
    overrides : mapping, optional
        Parameters or knobs of a scene file to change.
    progress : Progress
        Called for every phase.

    Returns
    -------
    Linearization
        Matrices, modes, state space; in SI.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    system = compile_source(source, overrides=overrides, progress=progress)
    made = _linearize(system, time, about, frame)
    for note in (*system.notes, *made.notes):
        if REUSED not in note:
            warnings.warn(note, FlexmbWarning, stacklevel=2)
    return made


def _linearize(system: CompiledModel, time: Time | None, about: str, frame: str) -> Linearization:
    from flexmb.analysis.linear.linearization import linearize_state
    from flexmb.analysis.validity.validity_monitor import limits_of_vibrations

    first = state_of(system, time, about)
    made = linearize_state(first.compiled, system.model, first.state, frame=frame)
    return replace(made, notes=(*made.notes, *limits_of_vibrations(made)))


def state_of(system: CompiledModel, time: Time | None, about: str) -> Assembled | Equilibrium:
    """The state of a compiled model about which it is linearised; see `linearize`."""
    from flexmb.analysis.assembly.initial_state import assemble

    if about not in STARTS:
        raise SceneError.from_problems(
            [Problem("about", f'unknown "{about}"', STARTS, nearest(about, STARTS))]
        )
    compiled, model = system.compiled, system.model
    if system.result is not None:
        return assemble(compiled, model, begin=system.state_at(time))
    if time is not None:
        what = "a scene has no time: give the result of a run (flexmb run), or leave it out"
        raise SceneError.from_problems([Problem("time", what)])
    if about == "initial":
        about = "undeformed" if model.dynamics is None else model.dynamics.start
    if about == "static":
        from flexmb.analysis.equilibrium_search import find_equilibrium

        return find_equilibrium(compiled, model)
    return assemble(compiled, model, start=about)


def sweep_modes(
    source: str | Path | Callable[[float], Model],
    parameter: str,
    values: Sequence[float | str],
    *,
    about: str = "quasi-static",
    frame: str = "auto",
    overrides: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> ModeSweep:
    """Linearise a scene for several values of a parameter: for Campbell diagrams and root loci.

    Parameters
    ----------
    source : path or callable
        A scene file, or a function that makes a model for a value.
    parameter : str
        A parameter or knob of the scene, such as ``"speed"`` or ``"forces.spring.stiffness"``.
    values : sequence of float
        Its values.
    about, frame, overrides, progress
        As of `linearize`.

    Returns
    -------
    ModeSweep
        Modes followed from value to value.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message; for which value.
    """
    from flexmb.analysis.linear.linearization import ModeSweep

    if not len(values):
        raise SceneError.from_problems([Problem("values", "at least one is needed")])
    numbers = read_values(values, parameter)
    made = []
    for k, value in enumerate(numbers):
        progress("modes", k / len(numbers), f"{parameter} = {value:g}")
        if callable(source):
            system = compile_source(source(float(value)), progress=silent)
        else:
            changes = {**(overrides or {}), parameter: f"{float(value)!r}"}
            system = compile_source(source, overrides=changes, progress=silent)
        made.append(_linearize(system, None, about, frame))
    progress("modes", 1.0)
    return ModeSweep.of(parameter, numbers, made)


def check_modes(model: Model, folder: Path) -> list[CheckOutcome]:
    """One outcome for each known linearised mode of a scene file; a missing mode gives NaN.

    Each set of parameters is a model with flexible bodies in a separate folder.
    """
    frequencies: dict[tuple[tuple[str, float], ...], Any] = {}
    outcomes = []
    source = model.source
    for check in model.mode_checks:
        assert source is not None
        key = tuple(check.parameters.items())
        if key not in frequencies:
            changes = {**source.overrides, **{name: repr(value) for name, value in key}}
            bodies = folder / "linear_modes"
            system = compile_source(source.path, overrides=changes, output=bodies)
            vibrations = _linearize(system, None, STARTS[0], "auto").frequencies
            frequencies[key] = np.sort(vibrations[vibrations > 0.0])
        modes = frequencies[key]
        value = float(modes[check.linear_mode - 1]) if check.linear_mode <= len(modes) else math.nan
        values = "".join(f", {name} = {value:g}" for name, value in key)
        what = f"linear mode {check.linear_mode}{values}"
        numbers = (value, check.value, check.tolerance)
        computed, expected, tolerance = (model.units.written(each, "Hz") for each in numbers)
        outcomes.append(CheckOutcome(what, None, computed, expected, tolerance, check.source))
    return outcomes


def render_mode_shapes(
    made: Linearization, folder: str | Path, modes: Sequence[int] = (1, 2, 3, 4, 5, 6)
) -> list[Path]:
    """Draw a machine displaced by some of its modes.

    Parameters
    ----------
    made : Linearization
        The model.
    folder : path
        Gets `mode_1.png`, ... and `mode_1.h5`, ...
    modes : sequence of int
        Their numbers, from 1; numbers that do not exist are skipped.

    Returns
    -------
    list of Path
        The pictures.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    from flexmb.flexbody import save
    from flexmb.results import Result
    from flexmb.results.output_block import OutputBlock
    from flexmb.results.run_summary import MODE_SHAPE
    from flexmb.results.writer import ResultWriter
    from flexmb.view.picture import render

    target, compiled = writable_folder(Path(folder)), made.compiled
    files = {name: f"{name}.flexbody.h5" for name in compiled.flexbodies}
    for name, body in compiled.flexbodies.items():
        save(body, target / files[name])
    scene = made.model.to_scene_dict(target, files)
    for section in ("check", "dynamics", "kinematics", "statics", "study", "results", "view"):
        scene.pop(section, None)
    scene["view"] = {"outline": False}  # of bodies that follow a joint, whose slopes are large here
    layout, pictures = compiled.layout, []
    for k in modes:
        if not 1 <= k <= len(made.eigenvalues):
            continue
        title = made.model.title or "mode"
        scene["title"] = f"{title}: mode {k}, {made.frequencies[k - 1]:.4g} Hz"
        phases = 2.0 * np.pi * np.arange(_PHASES + 1) / _PHASES
        q = np.array([made.displaced(k - 1, _AMPLITUDE, phase) for phase in phases])
        n = len(phases)
        widths = {
            "v": layout.nv, "vd": layout.nv, "lam": layout.nc, "drift": 2,
            "reactions": 12 * len(layout.reactions), "sensors": len(layout.channels),
            "energy": len(layout.energies),
        }  # fmt: skip
        zeros = {name: np.zeros((n, width)) for name, width in widths.items()}
        rows = OutputBlock(t=phases / (2.0 * np.pi), q=q, **zeros)
        path = target / f"mode_{k}.h5"
        with ResultWriter(path, layout, n, scene=scene, flexbodies=files) as writer:
            writer.append(rows)
            writer.finish({MODE_SHAPE: k}, "finished", "")
        picture = target / f"mode_{k}.png"
        pictures.append(render(Result(path), 0.0, ghosts=_GHOSTS, exaggeration=1.0, output=picture))
    return pictures
