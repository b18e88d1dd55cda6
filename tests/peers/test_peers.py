"""The mechanisms that are timed beside another program move as the textbook says in both."""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.model import Model
from tests.peers.scenes import SCENES
from tests.peers.work_precision import Exudyn, Flexmb


@pytest.mark.parametrize("name", SCENES)
def test_the_model_of_flexmb_moves_as_the_textbook_says(name):
    point = Flexmb(SCENES[name], verify=False).point(1e-8)
    assert point.error < 1e-8


@pytest.mark.seconds
@pytest.mark.parametrize("name", SCENES)
def test_exudyn_goes_to_the_same_motion_with_the_square_of_its_step(name):
    pytest.importorskip("exudyn")
    from tests.peers.with_exudyn import MODELS, solvers

    for how, make in MODELS[name].items():
        settings = list(solvers(how).values())[-1]
        coarse, fine = (Exudyn(SCENES[name], make, **settings).point(n) for n in (4000, 8000))
        assert fine.error < 1e-3
        assert fine.error < 0.3 * coarse.error or fine.error < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("modes", [24, 6, 0], ids=["all of the mesh", "12", "6"])
def test_the_reduced_body_of_exudyn_moves_as_that_of_flexmb(modes, tmp_path):
    """A free body of two soft elements that turns and bends, with the same K, M and modes.

    With all modes both are right: the nodes of the mesh in the global frame are a third code.
    """
    pytest.importorskip("exudyn")
    from tests.peers.reduced_body import ends_of_pushed_body
    from tests.truth.test_all_nodes import END, PUSH, Nodes, bar, elasticity, inertia

    basis = bar()
    K, M = elasticity.assemble(basis), inertia.assemble(basis)
    nodes, times = Nodes(basis, K, M), np.linspace(0.0, END, 11)
    ends = {end: {"group": end, "type": "rbe3"} for end in PUSH}
    body = flexmb.reduce(basis, stiffness=K, mass=M, modes=modes, interfaces=ends)
    made = Model("free body")
    made.add_body("bar", body)
    for end, value in PUSH.items():
        force = [f"{component}*sin(pi*t)**2" for component in value]
        made.add_force(end, "force", at=f"bar.{end}", value=force)
        made.add_sensor(end, "position", of=f"bar.{end}")
    made.set_dynamics(duration=END, outputs=10, accuracy=1e-8)
    made.set_validity(truncation="any", inertia_loads="any", speed="any")
    run = flexmb.simulate(made, output=tmp_path)
    mine = [np.stack([run[f"{end}.{axis}"] for axis in "xyz"], axis=1) for end in PUSH]
    if modes == 24:
        motion = nodes.motion(times)
        for end, one in zip(PUSH, mine, strict=True):
            np.testing.assert_allclose(one, motion[:, nodes.ends[end]].mean(axis=1), atol=1e-8)
    Phi = body.nodes.Phi_t[np.argsort(body.nodes.ids)].reshape(-1, body.m)
    pushes = [
        (np.flatnonzero(nodes.ends[end]), lambda t, F=value: np.sin(np.pi * t) ** 2 * np.array(F))
        for end, value in PUSH.items()
    ]
    errors = []
    for h in (1e-3, 5e-4):
        theirs = ends_of_pushed_body(
            nodes.x, np.kron(nodes.m, np.eye(3)), nodes.K, Phi, pushes, times, h
        )
        errors.append(max(np.abs(a - b).max() for a, b in zip(mine, theirs, strict=True)))
    assert errors[1] < 3e-7
    assert errors[1] < 0.3 * errors[0]
