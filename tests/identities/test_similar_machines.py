"""One machine in metres, millimetres or micrometres moves alike: nothing in the code has a size.

All quantities are scaled by units of length L, mass M and time T, so that x(t)/L as a function of
t/T must not depend on them. Fixed steps; 1e-8 of the amplitude.
"""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.flexbody import FlexBody
from flexmb.model import Model

UNITS = [(1e-3, 1e-3, 1.0), (1e-6, 1e-9, 1e-3), (1e3, 1e9, 60.0)]
METHODS = ["generalized-alpha", "radau", "explicit-rk"]
SLOW = pytest.mark.slow


class Units:
    """Factors of quantities by their dimensions."""

    def __init__(self, L, M, T):
        self.L, self.M, self.T = L, M, T

    def __call__(self, value, L=0.0, M=0.0, T=0.0):
        return (np.asarray(value, float) * self.L**L * self.M**M * self.T**T).tolist()


def swinging_linkage(u):
    """A double pendulum with a spring to ground, a bushing's damping and a stop."""
    made = Model("linkage", gravity=u([0, -9.81, 0], L=1, T=-2))
    for k in range(2):
        made.add_body(f"b{k}", mass=u(1 + k, M=1), inertia=u([0.02, 0.03, 0.04], L=2, M=1),
                      position=u([0.5 * k + 0.25, 0, 0], L=1))  # fmt: skip
        made.add_marker(f"b{k}.in", position=u([-0.25, 0, 0], L=1))
        made.add_marker(f"b{k}.out", position=u([0.25, 0, 0], L=1))
    made.add_joint("a", "revolute", between=["ground", "b0.in"], axis="z")
    made.add_joint("b", "spherical", between=["b0.out", "b1.in"])
    made.add_force("spring", "spring-damper", between=["ground", "b1.out"],
                   stiffness=u(40, M=1, T=-2), damping=u(0.5, M=1, T=-1),
                   free_length=u(0.7, L=1))  # fmt: skip
    made.add_force("stop", "rotational-stop", joint="a", lower=-0.6,
                   stiffness=u(200, L=2, M=1, T=-2), damping=u(1, L=2, M=1, T=-1),
                   depth=1e-3)  # fmt: skip
    made.add_sensor("tip", "position", of="b1.out")
    return made


def rubbing_crank(u, speed=None):
    """A slider-crank with friction on its guide, driven or from rest under its weight."""
    made = Model("crank", gravity=u([0, -9.81, 0], L=1, T=-2))
    for name, mass, length, x in (("crank", 1, 0.2, 0.1), ("rod", 2, 0.6, 0.5)):
        made.add_body(name, mass=u(mass, M=1), inertia=u([0.01, 0.06, 0.06], L=2, M=1),
                      position=u([x, 0, 0], L=1))  # fmt: skip
        made.add_marker(f"{name}.in", position=u([-length / 2, 0, 0], L=1))
        made.add_marker(f"{name}.out", position=u([length / 2, 0, 0], L=1))
    made.add_body("block", mass=u(1, M=1), inertia=u([0.01] * 3, L=2, M=1),
                  position=u([0.8, 0, 0], L=1))  # fmt: skip
    made.add_joint("a", "revolute", between=["ground", "crank.in"], axis="z")
    made.add_joint("b", "revolute", between=["crank.out", "rod.in"], axis="z")
    made.add_joint("c", "spherical", between=["rod.out", "block"])
    made.add_joint("d", "prismatic", between=["ground", "block"], axis="x")
    made.add_force("rub", "joint-friction", joint="d", static=0.3, dynamic=0.2,
                   stribeck_speed=u(0.05, L=1, T=-1), stiffness=u(1e5, M=1, T=-2),
                   damping=u(100, M=1, T=-1))  # fmt: skip
    if speed is not None:
        made.add_driver("motor", joint="a", angle=f"{speed / u.T!r}*t")
    made.add_sensor("tip", "position", of="block")
    return made


def driven_crank(u):
    return rubbing_crank(u, 10.0)


def bouncing_ball(u):
    """A ball that bounces and slides, with rolling and dry friction."""
    made = Model("ball", gravity=u([0, 0, -9.81], L=1, T=-2))
    made.add_body("ball", mass=u(2, M=1), inertia=u([0.008] * 3, L=2, M=1),
                  position=u([0, 0, 0.15], L=1), velocity=u([0.5, 0, 0], L=1, T=-1))  # fmt: skip
    made.add_force(
        "floor", "contact", between=["ball", "ground"],
        shapes=[{"type": "sphere", "radius": u(0.1, L=1)}, {"type": "plane"}],
        stiffness=u(1e6, L=-0.5, M=1, T=-2), exponent=1.5, restitution=0.5,
        least_speed=u(1e-3, L=1, T=-1),
        friction={"static": 0.3, "dynamic": 0.2, "stiffness": u(1e4, M=1, T=-2),
                  "damping": u(10, M=1, T=-1), "stribeck_speed": u(0.05, L=1, T=-1)},
    )  # fmt: skip
    made.add_sensor("tip", "position", of="ball")
    return made


def beam(u) -> FlexBody:
    return flexmb.reduce(
        {"type": "beam", "length": u(1.0, L=1), "divisions": 10}, name="beam", modes=4,
        material={"E": u(7e9, L=-1, M=1, T=-2), "nu": 0.3, "density": u(2700, L=-3, M=1)},
        sections={"all": {"type": "rectangle", "y": u(0.02, L=1), "z": u(0.03, L=1)}},
        interfaces={"root": "start", "tip": "end"},
    )  # fmt: skip


def driven_beam(u):
    """A beam that a driver turns, with a mass at its tip."""
    made = Model("beam", gravity=u([0, -9.81, 0], L=1, T=-2))
    made.add_body("beam", beam(u))
    made.add_body("end", mass=u(0.5, M=1), inertia=u([1e-3] * 3, L=2, M=1),
                  position=u([1, 0, 0], L=1))  # fmt: skip
    made.add_joint("pin", "revolute", between=["ground", "beam.root"], axis="z")
    made.add_joint("weld", "fixed", between=["beam.tip", "end"])
    made.add_driver("motor", joint="pin", angle=f"0.5*({1 / u.T!r}*t)**2")
    made.add_sensor("tip", "position", of="end", relative_to="beam.root")
    return made


def shaken_beam(u):
    """A clamped beam that a harmonic force bends a little."""
    made = Model("shaken", gravity=[0, 0, 0])
    made.add_body("beam", beam(u))
    made.add_joint("root", "fixed", between=["ground", "beam.root"])
    force = f"{u(2.0, L=1, M=1, T=-2)!r}*sin({60 / u.T!r}*t)"
    made.add_force("shaker", "force", at="beam.tip", value=[0, force, 0])
    made.add_sensor("tip", "position", of="beam.tip")
    return made


def run(make, factors, method, **steps):
    """The result; (rows, 3) places of the tip over the unit of length."""
    u = Units(*factors)
    made = make(u)
    made.set_dynamics(duration=u(0.4, T=1), outputs=20, method=method, **steps)
    result = flexmb.simulate(made)
    return result, np.column_stack([result[f"tip.{c}"] for c in "xyz"]) / u.L


def path(make, factors, method):
    step = 5e-4 if method == "explicit-rk" and make is driven_beam else 1e-3
    return run(make, factors, method, step=Units(*factors)(step, T=1))[1]


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("make", [swinging_linkage, bouncing_ball, driven_beam])
def test_machines_of_all_sizes_move_alike(make, method):
    wanted = path(make, (1.0, 1.0, 1.0), method)
    for factors in UNITS:
        off = path(make, factors, method) - wanted
        assert np.abs(off).max() < 1e-8 * np.ptp(wanted, axis=0).max(), factors


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
@pytest.mark.parametrize("method", METHODS[:2])
@pytest.mark.parametrize("make", [driven_crank, rubbing_crank])
def test_machines_of_all_sizes_take_the_same_steps(make, method):
    """With error control too, and the same reactions: a moment beside forces has no say."""
    wanted, tip = run(make, (1.0, 1.0, 1.0), method, accuracy=1e-4)
    friction = wanted.lam[:, -1]
    for L, M, T in [(1e6, 1.0, 1.0), (1e-3, 1e-3, 60.0)]:
        found, place = run(make, (L, M, T), method, accuracy=1e-4)
        assert found.statistics["steps"] == pytest.approx(wanted.statistics["steps"], rel=0.05)
        assert np.abs(place - tip).max() < 1e-8 * np.ptp(tip, axis=0).max()
        force = found.lam[:, -1] / (M * L / T**2)
        assert np.abs(force - friction).max() < 1e-8 * np.abs(friction).max(), (L, M, T)


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
@pytest.mark.parametrize("method", ["radau", pytest.param("generalized-alpha", marks=SLOW)])
@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_flexible_machines_of_all_sizes_take_the_same_steps(method, size):
    """Of one material; modes of a light body are large, and their scale was that of its points."""
    wanted, tip = run(shaken_beam, (1.0, 1.0, 1.0), method, accuracy=1e-4)
    found, place = run(shaken_beam, (size, size**3, size), method, accuracy=1e-4)
    assert found.statistics["steps"] == pytest.approx(wanted.statistics["steps"], rel=0.2)
    assert np.abs(place - tip).max() < 1e-4 * np.ptp(tip, axis=0).max()


@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
def test_newton_stops_alike_whatever_the_unit_of_a_stroke():
    """What round-off leaves of a stroke that a coordinate follows counts over the model size."""
    counts = []
    for factors in [(1.0, 1.0, 1.0), (1e6, 1.0, 1.0)]:
        found, _ = run(rubbing_crank, factors, "radau", step=1e-3)
        counts.append(found.statistics["residual_evaluations"])
    assert counts[1] == pytest.approx(counts[0], rel=0.02)


@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
def test_a_machine_of_a_thousand_kilometres_does_not_come_apart():
    """Joints that drift, as by Baumgarte's method, are judged over the size of the machine."""
    found, _ = run(swinging_linkage, (1e6, 1.0, 1.0), "baumgarte", accuracy=1e-3)
    assert found.status == "finished" and found.drift[:, 0].max() > 1e-3
