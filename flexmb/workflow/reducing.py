"""Flexible bodies on their own, without a run: of a mesh file, or of a scene.

In: a mesh and its options, or a scene. Out: bodies and their files, on request with a report that
compares each with the full model it comes from, and the known frequencies of the scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, SceneError, nearest
from flexmb.progress import Progress, silent
from flexmb.workflow.bodies import flexible_bodies
from flexmb.workflow.frequencies import frequency_outcomes
from flexmb.workflow.place import output_folder, writable_folder
from flexmb.workflow.reports import CheckOutcome

if TYPE_CHECKING:
    from flexmb.fe import Stopwatch
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model

__all__ = ["Reduced", "ReducedScene", "reduce_mesh", "reduce_scene"]


@dataclass(frozen=True)
class Reduced:
    """A flexible body, its file, and how good it is where that was asked for."""

    body: FlexBody
    path: Path
    report: Any = None  # a QualityReport of the finite-element half


@dataclass(frozen=True)
class ReducedScene:
    """The flexible bodies of a scene."""

    bodies: tuple[Reduced, ...]
    notes: list[str] = field(default_factory=list)
    checks: list[CheckOutcome] = field(default_factory=list)


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
) -> Reduced:
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
        Told every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb import fe
    from flexmb.flexbody import save

    found: dict[str, Any] = {}
    watch = fe.Stopwatch(progress)
    body = fe.reduce(
        mesh,
        material=material,
        interfaces=interfaces or {},
        sections=sections or None,
        progress=watch,
        inspect=_judge(found, up_to, watch) if report else None,
        **options,
    )
    path = Path(output) if output is not None else Path(f"{Path(mesh).stem}.flexbody.h5")
    return Reduced(body, save(body, path), found.get(body.name))


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
        Reduce anew even if an equal reduction is there.
    report : bool
        Whether to compare the bodies with their full models; they are reduced anew then.
    up_to : float, optional
        Compare frequencies up to this one [Hz].
    progress : Progress
        Told every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb.fe import Stopwatch
    from flexmb.model import load_scene

    path = Path(path)
    model = load_scene(path, dict(overrides or {}))
    chosen = _chosen(model, body)
    folder = writable_folder(Path(output) if output is not None else output_folder(path))
    reports: dict[str, Any] = {}
    watch = Stopwatch(progress)
    bodies, files, notes = flexible_bodies(
        model,
        folder,
        fresh=fresh,
        only=chosen,
        inspect=_judge(reports, up_to, watch) if report else None,
        progress=watch,
    )
    reduced = tuple(Reduced(bodies[k], files[k], reports.get(k)) for k in bodies)
    return ReducedScene(reduced, notes, frequency_outcomes(model, bodies))


def _chosen(model: Model, body: str | None) -> tuple[str, ...]:
    flexible = tuple(name for name, spec in model.bodies.items() if spec.flexible)
    if body is None and flexible:
        return flexible
    if body in flexible:
        return (str(body),)
    what = f'there is no flexible body "{body}"' if flexible else "the scene has no flexible body"
    near = nearest(str(body), flexible) if body is not None else ()
    raise SceneError.from_problems([Problem("bodies", what, flexible, near)])


def _judge(found: dict[str, Any], up_to: float | None, watch: Stopwatch) -> Any:
    """What :func:`flexmb.reduce` calls with all that it made: keeps a report by body name."""

    def judge(fe: Any, basis: Any, modes: Any, body: Any, mirror: Any) -> None:
        from flexmb.fe.reduction.quality_report import quality_report

        phases = watch.lap()
        found[body.name] = quality_report(
            fe, basis, modes, body, up_to, mirror=mirror, phases=phases, progress=watch
        )

    return judge
