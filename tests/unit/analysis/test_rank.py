"""One decision on the rank: the same for large and small machines, modes apart, states left out."""

from __future__ import annotations

import numpy as np
import pytest
from generators import cloud
from linkages import four_bar_angles, turned
from mechanisms import crank_slider

import flexmb
from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.assembly.jacobian import (
    ConstraintRows,
    Decomposition,
    WeightedJacobian,
    constraint_rank,
    n_free,
    null_space,
    numerical_rank,
    with_driven_coordinates,
)
from flexmb.engine.compile import compile_system
from flexmb.flexbody import Interface
from flexmb.model import Model

BARS = np.array([1.0, 2.0, 1.5, 2.2])


def linkage(size, plane="xy", driven=True):
    """A four-bar of this size [m]."""
    a, b, c, d = size * BARS
    one, two, three = 0.6, *four_bar_angles(BARS, 0.6, 1)
    made = Model("four-bar", plane=plane)
    places = {"crank": (0, 0, one, a), "coupler": (a * np.cos(one), a * np.sin(one), two, b),
              "rocker": (d, 0, three, c)}  # fmt: skip
    for name, (x, y, angle, length) in places.items():
        moment = length**2 / 12
        made.add_body(
            name, mass=1.0, inertia=[moment, moment, moment], position=[x, y, 0],
            orientation=turned(angle),
        )  # fmt: skip
        made.add_marker(f"{name}.end", position=[length, 0, 0])
    made.add_marker("ground.right", position=[d, 0, 0])
    pins = {
        "left": ("ground", "crank"),
        "right": ("ground.right", "rocker"),
        "crank_pin": ("crank.end", "coupler"),
        "rocker_pin": ("coupler.end", "rocker.end"),
    }
    for name, between in pins.items():
        made.add_joint(name, "revolute", between=list(between), axis="z")
    if driven:
        made.add_driver("motor", joint="left", angle="t")
    return made


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1.0, 1e3, 1e9])
def test_the_rank_is_that_of_a_machine_of_any_size(size):
    compiled = compile_system(linkage(size))
    rank = constraint_rank(compiled, assemble(compiled, linkage(size)).work)
    assert rank == n_free(compiled) == 9


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_without_weights_the_size_of_the_machine_would_decide(size):
    compiled = compile_system(linkage(size))
    Cq = (
        ConstraintRows(compiled).evaluate(compiled.initial_q).Cq[:, compiled.system.kkt.column >= 0]
    )
    assert numerical_rank(np.linalg.svd(Cq, compute_uv=False)) < 9


@pytest.mark.parametrize(("tilt", "rank"), [(0.0, 5), (1e-10, 5), (1e-6, 6), (1e-2, 6)])
def test_hinges_of_a_door_out_of_line_hold_it_from_a_hundred_millionth_on(tilt, rank):
    """Two pins on one line leave the turn; a tilt below 1e-8 rad is what digits of a pose leave."""
    made = Model("door")
    made.add_body("door", mass=1.0, inertia=[1, 1, 1])
    made.add_marker("door.top", position=[0, 0, 1])
    made.add_marker("ground.top", position=[0, 0, 1])
    made.add_joint("low", "revolute", between=["ground", "door"], axis="z")
    made.add_joint("high", "revolute", between=["ground.top", "door.top"], axis=[tilt, 0, 1])
    compiled = compile_system(made)
    assert constraint_rank(compiled, assemble(compiled, made).work) == rank


def beam_between_walls():
    """A beam with six modes, welded to the ground at both ends."""
    rng = np.random.default_rng(3)
    ends = [Interface(name, x, *rng.normal(size=(2, 3, 6))) for name, x in
            (("a", np.zeros(3)), ("b", np.array([1.0, 0, 0])))]  # fmt: skip
    made = Model("beam between walls")
    made.add_body("beam", cloud(rng, 6).flexbody("beam", ends))
    made.add_marker("ground.b", position=[1, 0, 0])
    made.add_joint("left", "fixed", between=["ground", "beam.a"])
    made.add_joint("right", "fixed", between=["ground.b", "beam.b"])
    return made


def test_modes_take_up_rows_that_are_redundant_without_them():
    compiled = compile_system(beam_between_walls())
    jacobian = ConstraintRows(compiled).evaluate(compiled.initial_q).jacobian
    rigid = jacobian.without_modes()
    assert (jacobian.A.shape, jacobian.decomposition.rank) == ((12, 12), 12)
    assert (rigid.A.shape, rigid.decomposition.rank) == ((12, 6), 6)


def test_states_are_no_motion():
    made = linkage(1.0)
    made.add_state("heat", rate="1 - heat", start=0)
    compiled = compile_system(made)
    state = assemble(compiled, made)
    assert constraint_rank(compiled, state.work) == 9 == n_free(compiled) - 1
    jacobian = ConstraintRows(compiled).evaluate(state.state.q).jacobian
    assert jacobian.A.shape[1] == jacobian.decomposition.rank == 9


def test_check_and_run_count_the_same_redundant_equations():
    """Three of a loop of revolute joints, in the report of the mobility and in that of a run."""
    made = crank_slider("RRRT", driven=True)
    compiled = compile_system(made)
    rank = constraint_rank(compiled, assemble(compiled, made).work)
    assert compiled.layout.nc - rank == flexmb.mobility(made).redundant == 3


@pytest.mark.parametrize("shape", [(0, 4), (4, 0), (0, 0)])
def test_an_empty_matrix_has_no_rank(shape):
    decomposition = Decomposition.of(np.zeros(shape))
    assert (decomposition.rank, decomposition.condition) == (0, 1.0)
    assert decomposition.free.shape == (shape[1], shape[1]) == null_space(np.zeros(shape)).shape
    assert decomposition.row_dependencies.shape == (shape[0], shape[0])


def test_velocities_of_free_motions_leave_all_rows_at_rest():
    made = linkage(1e-3, plane=None, driven=False)
    compiled = compile_system(made)
    pose = ConstraintRows(compiled).evaluate(compiled.initial_q)
    jacobian = WeightedJacobian.of(compiled, pose.Cq)
    v = jacobian.velocities(jacobian.decomposition.free)
    assert v.shape == (compiled.layout.nv, 1) and np.abs(v).max() > 0.1
    np.testing.assert_allclose(pose.Cq @ v, 0.0, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 2])
def test_a_dead_point_of_a_free_motion_is_not_driven(angle):
    """Steps were limited by accelerations of a pendulum that began at the bottom or level."""
    made, place = flexmb.Model("pendulum"), np.array([np.sin(angle), 0.0, -np.cos(angle)])
    made.add_body("table", mass=2.0, inertia=[0.01] * 3)
    made.add_joint("rail", "prismatic", between=["ground", "table"], axis="z")
    made.add_driver("motor", joint="rail", stroke="0.02*sin(40*t)")
    made.add_body("bob", mass=1.0, inertia=[0.01] * 3, position=place.tolist())
    made.add_marker("bob.top", position=(-place).tolist())
    made.add_joint("hinge", "revolute", between=["ground", "bob.top"], axis="y")
    compiled = compile_system(made)
    flags = with_driven_coordinates(compiled, compiled.initial_q).system.driven
    # of the bob: across the plane, and the other two axes of rotation
    assert flags.tolist() == [1] * 6 + [0, 1, 0, 1, 0, 1]
