"""Setting up a model takes operations in proportion to its bodies: counted, not timed.

Counted are the calls of functions, those of C among them, and how often two names are compared: a
search in a list of names is one call and as many comparisons as there are names.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from flexmb.analysis.assembly import initial_state, positions, velocities
from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.assembly.jacobian import constraint_rank
from flexmb.engine.compile import compile_system
from flexmb.engine.state import State, Work
from flexmb.engine.symbolic import Blocks, analyse
from flexmb.engine.tables import System
from flexmb.model import Model
from flexmb.results import Result
from flexmb.results.writer import ResultWriter

FEW, MANY = 150, 300
MOST = 2.1  # times as many operations for twice as many bodies


class Name(str):
    """A text that counts how often it is compared with another one."""

    compared = 0

    def __eq__(self, other: object) -> bool:
        Name.compared += 1
        return str.__eq__(self, other)  # type: ignore[arg-type]

    __hash__ = str.__hash__


def operations(task: Callable[[], object]) -> int:
    """Calls and comparisons of names in a task."""
    calls = 0

    def see(frame: object, event: str, argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    Name.compared = 0
    sys.setprofile(see)
    try:
        task()
    finally:
        sys.setprofile(None)
    return calls + Name.compared


def chain(joint: str, n: int) -> Model:
    """n bars, each hung on the one before by a joint; asked for velocities."""
    model = Model("chain", gravity=[0, 0, -9.81])
    axis = None if joint == "spherical" else "y"
    end = "ground"
    for k in range(n):
        name = f"b{k}"
        model.add_body(
            Name(name), mass=1.0, center=[0.5, 0, 0], inertia=[0.1, 0.1, 0.1], position=[k, 0, 0],
            angular_velocity=[0, 0, 0],
        )  # fmt: skip
        model.add_marker(f"{name}.end", position=[1, 0, 0])
        model.add_joint(Name(f"j{k}"), joint, between=[Name(end), Name(name)], axis=axis)
        end = f"{name}.end"
    model.set_dynamics(duration=1.0, step=1e-3)
    return model


def star(n: int) -> Model:
    """n bars on spherical joints around one body."""
    model = Model("star")
    model.add_body(Name("hub"), mass=1.0, inertia=[0.1, 0.1, 0.1])
    for k in range(n):
        model.add_body(Name(f"b{k}"), mass=1.0, inertia=[0.1, 0.1, 0.1])
        model.add_joint(Name(f"j{k}"), "spherical", between=[Name("hub"), Name(f"b{k}")])
    return model


def gear_train(n: int) -> Model:
    """n wheels on the ground, each driven by the one before."""
    model = Model("gear train")
    for k in range(n):
        model.add_body(Name(f"b{k}"), mass=1.0, inertia=[0.1, 0.1, 0.1], position=[k, 0, 0])
        model.add_marker(f"ground.g{k}", position=[k, 0, 0])
        model.add_joint(Name(f"j{k}"), "revolute", between=[Name(f"ground.g{k}"), Name(f"b{k}")])
        if k:
            model.add_coupler(f"c{k}", "gear", joints=[Name(f"j{k - 1}"), Name(f"j{k}")], ratio=1)
    return model


def set_up(make: Callable[[int], Model], n: int, folder: Path) -> Iterator[tuple[str, int]]:
    """The stages before the time loop of a model of n bodies, and the operations of each."""
    model = make(n)
    yield "model", operations(lambda: make(n))
    yield "check", operations(model.validate)
    yield "tables", operations(lambda: compile_system(model))
    compiled = compile_system(model)

    def first_state() -> None:
        assert constraint_rank(compiled, assemble(compiled, model).work) is None

    def file() -> None:
        with ResultWriter(folder / "r.h5", compiled.layout, 2, scene=model.to_scene_dict()):
            pass
        Result(folder / "r.h5").channels("reactions")

    yield "first state", operations(first_state)
    yield "file", operations(file)


def at_rest(system: System, state: State, work: Work, level: int) -> float:
    """In place of the kernels: everything is where and as it should be."""
    work.con.C[:], state.vd[:], state.lam[:] = 0.0, 0.0, 0.0
    work.now.marker[:] = 0.0
    work.now.marker["R"] = np.eye(3)
    return 0.0


@pytest.mark.seconds
@pytest.mark.parametrize("joint", [pytest.param("spherical", marks=pytest.mark.slow), "revolute"])
def test_a_chain_takes_operations_in_proportion_to_its_bodies(
    joint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (positions, velocities):
        monkeypatch.setattr(module, "stage_solver", lambda *of: lambda level: at_rest(*of, level))
    monkeypatch.setattr(initial_state, "solve_stage", at_rest)

    def make(n: int) -> Model:
        return chain(joint, n)

    dict(set_up(make, FEW, tmp_path))  # what only the first one does
    few, many = (dict(set_up(make, n, tmp_path)) for n in (FEW, MANY))
    ratios = {stage: many[stage] / few[stage] for stage in few}
    assert max(ratios.values()) < MOST, ratios


@pytest.mark.parametrize("make", [star, pytest.param(gear_train, marks=pytest.mark.slow)])
def test_so_do_other_models(make: Callable[[int], Model]) -> None:
    def whole(n: int) -> int:
        return operations(lambda: compile_system(make(n)))

    whole(FEW)
    assert whole(MANY) < MOST * whole(FEW)


def test_a_search_among_names_would_be_counted() -> None:
    names = [Name(f"b{k}") for k in range(MANY)]
    assert operations(lambda: names.index(names[-1])) >= MANY - 1


@pytest.mark.parametrize("first", [-1, 0])
def test_the_elimination_order_of_a_star_takes_no_more_for_each_arm(first: int) -> None:
    """Around the ground and around a body."""

    def whole(n: int) -> int:
        pairs = [(first, k) for k in range(first + 1, n)]
        none: list[tuple[int, ...]] = [() for _ in pairs]
        columns = [list(range(6)) for _ in range(n)]
        blocks = Blocks(columns, [3] * len(pairs), pairs, none, [], none)
        return operations(lambda: analyse(blocks))

    assert whole(MANY) < MOST * whole(FEW)
