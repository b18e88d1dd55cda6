"""Partial and constant coupling in frames at interfaces: where their mass matrix is no mass."""

from __future__ import annotations

import re

import numpy as np
import pytest
from flexiblescenes import rod
from scipy.linalg import eigh, null_space

import flexmb
from flexmb.analysis.validity.deformed_inertia import DeformedInertiaMonitor, first_order_inertia
from flexmb.engine.compile import compile_system
from flexmb.errors import SolverError
from flexmb.flexbody.arrays import skew
from flexmb.flexbody.effects import frame_at_interface
from flexmb.flexbody.natural_modes import matrices_at_rest
from flexmb.model import Model
from flexmb.results.output_block import OutputBlock


def driven_bar(damping=None, **words):
    """A slender bar of 1 m whose hinge is driven unsteadily; its tip is free."""
    made = Model("bar")
    body = rod(0.01, 1.0, 10, 4, geometric_stiffening="full")
    made.add_body("bar", body, **words, **({} if damping is None else {"damping": damping}))
    made.add_joint("hinge", "revolute", between=["ground", "bar.root"], axis="z")
    made.add_driver("motor", joint="hinge", angle="4*t + 0.5*sin(6*t)")
    made.add_sensor("tip", "position", of="bar.tip")
    return made


def run(made):
    return flexmb.simulate(made, duration=0.3, accuracy=1e-5, outputs=60, verify=False)


@pytest.mark.seconds
@pytest.mark.parametrize("coupling", ["constant", "partial"])
@pytest.mark.parametrize("stiffening", ["none", "full"])
def test_a_run_that_diverges_by_its_frame_says_so(coupling, stiffening):
    """Not that it buckles or spins too fast, which is how the run ends."""
    words = {"inertia_coupling": coupling, "geometric_stiffening": stiffening}
    with pytest.raises(SolverError) as failed:
        run(driven_bar(frame="interface tip", **words))
    said = str(failed.value)
    assert f'{coupling} coupling in its frame at interface "tip"' in said
    assert 'take inertia_coupling = "full", or frame = "mean axis"' in said
    assert "buckle" not in said.split("\n")[0]


@pytest.mark.seconds
@pytest.mark.parametrize("interface", ["root", "tip"])
@pytest.mark.parametrize("stiffening", ["none", "full"])
def test_a_body_amid_others_that_diverges_by_its_frame_says_so(interface, stiffening):
    """Two bars that motors fold: joints of moving bodies hold the frame less than those at rest."""
    made, words = Model("arm"), {"inertia_coupling": "partial", "frame": f"interface {interface}"}
    for k, (name, size) in enumerate((("upper", 0.015), ("lower", 0.01))):
        body = rod(size, 1.0, 10, 4, geometric_stiffening="full")
        made.add_body(name, body, position=[k, 0, 0], geometric_stiffening=stiffening, **words)
    made.add_body("load", mass=1.0, inertia=[1e-3] * 3, position=[2, 0, 0])
    made.add_joint("shoulder", "revolute", between=["ground", "upper.root"], axis="z")
    made.add_joint("elbow", "revolute", between=["upper.tip", "lower.root"], axis="z")
    made.add_joint("weld", "fixed", between=["lower.tip", "load"])
    made.add_driver("lift", joint="shoulder", angle="step5(t, 0, 0, 0.6, 1.2)")
    made.add_driver("fold", joint="elbow", angle="step5(t, 0.1, 0, 0.8, -1.5)")
    made.add_sensor("load", "position", of="load")
    with pytest.raises(SolverError) as failed:
        run(made)
    said = str(failed.value).split("\n")[0]
    assert f'mass matrix of partial coupling in its frame at interface "{interface}"' in said
    assert "make it stiffer" not in said


def test_stiffening_that_takes_mass_in_its_frame_is_told(tmp_path):
    """By the least eigenvalue of the whole mass matrix, with the shape of the last row."""
    made = driven_bar(frame="interface tip", geometric_stiffening="full")
    del made.drivers["motor"]
    made.add_driver("motor", joint="hinge", angle="4*t + 0.5*sin(30*t)")
    with pytest.raises(SolverError) as failed:
        flexmb.simulate(
            made, duration=0.3, accuracy=1e-5, outputs=600, verify=False, output=tmp_path
        )
    said = str(failed.value).split("\n")[0]
    assert 'geometric stiffening in its frame at interface "tip"' in said
    assert 'take frame = "mean axis"' in said and "buckle" not in said
    share = float(re.search(r"deflection of ([-\d.e]+) of its length", said)[1])

    body = frame_at_interface(made.bodies["bar"].flexbody, "tip")
    root, M = body.interface("root"), matrices_at_rest(body)[0]
    D = body.Mab - body.centrifugal_stiffness
    size = np.sqrt(np.diag(M))
    eta = flexmb.load_result(tmp_path).q[-1, 7:]
    rigid = root.Phi_t @ eta + np.cross(root.Phi_r @ eta, body.nodes.position - root.position)
    eta = eta / np.linalg.norm(body.nodes.Phi_t @ eta - rigid, axis=1).max()  # of 1 m

    def least(amount):
        x = amount * eta
        S = body.S0 + body.P @ x + (body.P @ x).T + np.einsum("abij,i,j->ab", D, x, x)
        P = body.P + np.einsum("abij,i->abj", D, x)
        changed, arm = M.copy(), skew(body.S1 + body.p @ x)
        changed[:3, 3:6], changed[3:6, :3] = -arm, arm
        changed[3:6, 3:6] = np.trace(S) * np.eye(3) - S
        changed[3:6, 6:] = [P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0]]
        changed[6:, 3:6] = changed[3:6, 6:].T
        held = np.zeros((5, len(M)))  # the place of the root, and its turns about x and y
        held[:3] = np.hstack([np.eye(3), -skew(root.position + root.Phi_t @ x), root.Phi_t])
        held[3:] = np.hstack([np.zeros((3, 3)), np.eye(3), root.Phi_r])[:2]
        free = null_space(held / size) / size[:, None]
        return np.linalg.eigvalsh(free.T @ changed @ free)[0]

    assert least(0.9 * share) > 0.0 > least(1.1 * share)


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("frame", "coupling"),
    [("mean axis", "constant"), ("mean axis", "partial"), ("interface root", "constant"),
     ("interface root", "partial"), ("interface tip", "full")],
)  # fmt: skip
def test_runs_that_hold_their_energy_say_nothing_of_it(frame, coupling):
    found = run(driven_bar(frame=frame, inertia_coupling=coupling))
    assert found.statistics["energy_balance_error"] < 1e-4
    assert not [note for note in found.notes if "take inertia_coupling" in note]


def test_the_mass_is_lost_at_the_deflection_that_is_told():
    """By the least eigenvalue of the whole mass matrix, of motions with the root held."""
    made = driven_bar(frame="interface tip", inertia_coupling="partial")
    del made.drivers["motor"]
    compiled = compile_system(made)
    body, q = compiled.flexbodies["bar"], compiled.initial_q.copy()
    root = body.interface("root")
    held = np.zeros((5, 6 + body.m))  # its place, and its turns about x and y
    held[:3] = np.hstack([np.eye(3), -skew(root.position), root.Phi_t])
    held[3:] = np.hstack([np.zeros((3, 3)), np.eye(3), root.Phi_r])[:2]
    M = matrices_at_rest(body)[0]
    size = np.sqrt(np.diag(M))
    free = null_space(held / size) / size[:, None]
    eta = 1e-2 * np.random.default_rng(1).normal(size=body.m) / size[6:]
    monitor = DeformedInertiaMonitor(compiled, made, q)
    q[7:] = eta
    none = np.zeros((1, 0))
    monitor.add(OutputBlock(np.ones(1), q[None], np.zeros((1, 6 + body.m)), *[none] * 6))
    (told,) = monitor.indicators()
    deflection = float(re.search(r"deflection of ([-\d.e]+) of its length", told.text())[1])

    moved = np.linalg.norm(body.nodes.Phi_t @ eta, axis=1).max()  # in its frame, of 1 m
    share = deflection / moved  # at which the mass is lost
    changed = M.copy()
    changed[:6, :6] += share * first_order_inertia(body) @ eta
    values = eigh(free.T @ changed @ free, free.T @ M @ free, eigvals_only=True)
    assert told.value > 1.0
    assert values[0] == pytest.approx(0.0, abs=0.05)


def test_the_change_of_the_inertia_is_that_of_points_that_move():
    """By masses at the nodes of the bar: p η and ∫ρ s uᵀ are sums over them."""
    body = frame_at_interface(rod(0.01, 1.0, 200, 4), "root")
    eta = np.zeros(body.m)
    eta[0] = 1e-3 / np.abs(body.nodes.Phi_t[:, :, 0]).max()
    s, u = body.nodes.position, body.nodes.Phi_t @ eta
    x = np.argsort(s[:, 0])
    share = np.gradient(s[x, 0]) * np.where(np.arange(len(x)) % (len(x) - 1), 1.0, 0.5)
    masses = np.empty(len(x))
    masses[x] = body.mass * share / share.sum()
    wanted = np.zeros((6, 6))
    for m, at, moved in zip(masses, s, u, strict=True):
        turn = np.hstack([np.eye(3), -skew(at)])
        change = np.hstack([np.zeros((3, 3)), -skew(moved)])
        wanted += m * (turn.T @ change + change.T @ turn)
    found = first_order_inertia(body) @ eta
    np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())
