"""``[part]``: one flexible body of a scene by itself, with supports and loads of its own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from flexmb.errors import Problem, nearest
from flexmb.flexbody.part_options import PART_LOADS, PartAnalysisOptions
from flexmb.flexbody.part_result import QUANTITIES, unit_of_quantity
from flexmb.model.lookup import ModelData, Scope
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.option_specs import spec_of, specs_of
from flexmb.model.quantities import Measured, Text
from flexmb.model.reading import Spec, bad_name

PART_LOAD_TYPES = specs_of(PART_LOADS)
"""Loads on a part by type."""
if TYPE_CHECKING:
    Base: TypeAlias = Spec
else:
    Base = spec_of(PartAnalysisOptions)


class PartSpec(Base):
    """One flexible body by itself: static solution, natural frequencies, buckling.

    ``body`` may be left out if the scene has one body with a mesh. Its joints are ignored: only the
    ``supports`` hold it, and all ``loads`` act together. A static solution is computed if there are
    loads or imposed displacements; ``frequencies`` are those of the supported part; ``buckling`` is
    the number of load factors; with ``preload`` the static stress and the spin change the
    frequencies.
    """

    body: Text | None = None
    if TYPE_CHECKING:
        supports: dict[str, Any]
        loads: dict[str, Any]

    def words(self) -> dict[str, Any]:
        """The options of :func:`flexmb.fe.part` as plain data in SI."""
        return self.model_dump(exclude_none=True, exclude={"body"})


class PartCheckSpec(Spec):
    """Known answer: the quantity ``part`` of a part analysis is ``value`` within ``tolerance``.

    Such as ``frequency.1``, ``load_factor.1``, ``displacement.tip.z``, ``reaction.root.Fz``,
    ``von_mises``, ``stress.17.top.xx``, ``section_force.3.1.Mz``, ``shell_force.17.Mx``.
    """

    part: Text
    value: Annotated[float, Measured()]
    tolerance: Annotated[float, Measured(sign="positive")]
    source: Text


def part_unit(quantity: Any) -> str | None:
    """SI unit of a quantity of a part; None if there is no such quantity."""
    return unit_of_quantity(quantity) if isinstance(quantity, str) else None


def select_part_body(model: ModelData) -> tuple[str, list[Problem]]:
    """The body of ``[part]``, and problems of its selection."""
    bodies = tuple(n for n, spec in model.bodies.items() if isinstance(spec, MeshBodySpec))
    name = None if model.part is None else model.part.body
    if name is None and len(bodies) == 1:
        return bodies[0], []
    if name in bodies:
        return str(name), []
    if name is None:
        what = "is missing: the scene has no body with a mesh" if not bodies else "is missing"
        return "", [Problem("part.body", what, bodies)]
    what = f'there is no body with a mesh "{name}"'
    return "", [Problem("part.body", what, bodies, nearest(name, bodies))]


def part_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of the body, of the interfaces named in supports and loads, and of known
    quantities."""
    model = scope.model
    for i, check in enumerate(model.part_checks):
        if part_unit(check.part) is None:
            word = check.part.partition(".")[0]
            what = f'unknown quantity of a part "{check.part}"'
            yield Problem(f"check[{i}].part", what, tuple(QUANTITIES), nearest(word, QUANTITIES))
        if model.part is None and not scope.broken.get("part"):
            yield Problem(f"check[{i}].part", "the scene has no [part]")
    if model.part is None and scope.broken.get("part"):
        return
    if model.part is None:
        for name, spec in model.bodies.items():
            if isinstance(spec, MeshBodySpec) and not spec.interfaces:
                yield Problem(f"bodies.{name}.interfaces", "is missing")
        return
    body, problems = select_part_body(model)
    if not scope.broken.get("bodies"):
        yield from problems
    places = {f"part.supports.{k}": s for k, s in model.part.supports.items()}
    places |= {f"part.loads.{k}": s for k, s in model.part.loads.items()}
    for where, spec in places.items():
        if bad := bad_name(where.rpartition(".")[2]):
            yield Problem(where, bad)
        end = getattr(spec, "interface", None)
        interfaces = tuple(getattr(model.bodies[body], "interfaces", ())) if body else (end,)
        if end is not None and end not in interfaces:
            what, near = f'{body} has no interface "{end}"', nearest(end, interfaces)
            yield Problem(f"{where}.interface", what, interfaces, near)
