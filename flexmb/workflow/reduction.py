"""Reductions on request: a mesh file, or the flexible bodies of a scene, with a report on each.

In: a mesh and its options, or a scene. Out: bodies and their files, a report that compares each
with the full model it comes from, and the known frequencies of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, SceneError, nearest
from flexmb.folders import output_folder, writable_folder
from flexmb.progress import Progress, Stopwatch, silent
from flexmb.units import SI, UnitSystem
from flexmb.workflow.flexible_bodies import flexible_bodies
from flexmb.workflow.run_report import CheckOutcome, check_frequencies

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model


@dataclass(frozen=True)
class ReducedBody:
    """A flexible body, its file, and on request the report on its quality."""

    body: FlexBody
    path: Path
    report: Any = None  # a QualityReport of the finite-element half


@dataclass(frozen=True)
class ReducedScene:
    """The flexible bodies of a scene."""

    bodies: tuple[ReducedBody, ...]
    notes: list[str] = field(default_factory=list)
    checks: list[CheckOutcome] = field(default_factory=list)
    units: UnitSystem = SI


def reduce_mesh(
    mesh: str | Path,
    *,
    material: Any,
    interfaces: Mapping[str, Any] | None = None,
    sections: Mapping[str, Any] | None = None,
    output: str | Path | None = None,
    report: bool = False,
    up_to: float | None = None,
    progress: Progress = silent,
    **options: Any,
) -> ReducedBody:
    """Reduce a mesh to a flexible body and save it (`<mesh>.flexbody.h5` by default).

    Parameters
    ----------
    mesh : path
        The mesh file.
    material, interfaces, sections, **options
        As for :func:`flexmb.reduce`.
    output : path, optional
        The file.
    report : bool
        Whether to compare the body with the full model, which takes about as long again.
    up_to : float, optional
        Compare frequencies up to this one [Hz].
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb import fe
    from flexmb.flexbody import save

    reports: dict[str, Any] = {}
    watch = Stopwatch(progress)
    body = fe.reduce(
        mesh,
        material=material,
        interfaces=interfaces or {},
        sections=sections or None,
        progress=watch,
        inspect=_quality_inspector(reports, up_to, watch) if report else None,
        **options,
    )
    path = Path(output) if output is not None else Path(f"{Path(mesh).stem}.flexbody.h5")
    return ReducedBody(body, save(body, path), reports.get(body.name))


def reduce_scene(
    path: str | Path,
    *,
    body: str | None = None,
    output: str | Path | None = None,
    overrides: Mapping[str, str] | None = None,
    fresh: bool = False,
    report: bool = False,
    up_to: float | None = None,
    progress: Progress = silent,
) -> ReducedScene:
    """Reduce the flexible bodies of a scene into its output folder, as a run would.

    Parameters
    ----------
    path : path
        The scene.
    body : str, optional
        Only this one.
    output : path, optional
        Folder; `out/<name of the scene's folder>` by default.
    overrides : mapping of str to str, optional
        Parameters or knobs to change.
    fresh : bool
        Reduce again even if an equal reduction is there.
    report : bool
        Whether to compare the bodies with their full models; they are reduced again then.
    up_to : float, optional
        Compare frequencies up to this one [Hz].
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb.model import load_scene

    path = Path(path)
    model = load_scene(path, dict(overrides or {}))
    names = _select_bodies(model, body)
    folder = writable_folder(Path(output) if output is not None else output_folder(path))
    reports: dict[str, Any] = {}
    watch = Stopwatch(progress)
    inspect = _quality_inspector(reports, up_to, watch) if report else None
    bodies, files, notes = flexible_bodies(
        model, folder, fresh=fresh, only=names, inspect=inspect, progress=watch
    )
    reduced = tuple(ReducedBody(bodies[k], files[k], reports.get(k)) for k in bodies)
    return ReducedScene(reduced, notes, check_frequencies(model, bodies), model.units)


def _select_bodies(model: Model, body: str | None) -> tuple[str, ...]:
    flexible = tuple(name for name, spec in model.bodies.items() if spec.flexible)
    if flexible and body in (None, *flexible):
        return flexible if body is None else (body,)
    what = f'there is no flexible body "{body}"' if flexible else "the scene has no flexible body"
    near = nearest(str(body), flexible) if body is not None else ()
    raise SceneError.from_problems([Problem("bodies", what, flexible, near)])


def _quality_inspector(
    reports: dict[str, Any], up_to: float | None, watch: Stopwatch
) -> Callable[..., None]:
    """A function to be called by :func:`flexmb.reduce`, which adds a report by body name."""

    def inspect(fe: Any, basis: Any, modes: Any, body: Any, mirror: Any) -> None:
        from flexmb.fe.reduction.quality_report import quality_report

        phases = watch.lap()
        reports[body.name] = quality_report(
            fe, basis, modes, body, up_to, mirror=mirror, phases=phases, progress=watch
        )

    return inspect
