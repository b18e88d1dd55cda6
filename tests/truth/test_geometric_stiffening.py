"""Geometric stiffening against rotating beams, a spin-up and columns under load."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from femeshes import line, solid_box
from scipy.optimize import brentq
from truthkit import run

from flexmb.errors import ReductionError
from flexmb.fe import Mesh, assemble, general, make_interfaces, rectangle, reduce, resolve
from flexmb.fe.assembly.assemble import geometric_stiffness
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.fe.reduction.geometric_stiffening import _force_per_mass, _rotation_stiffness
from flexmb.fe.reduction.inertia_relief import InertiaRelief, centrifugal_fields
from flexmb.model import Model

REFERENCE = json.loads(
    (Path(__file__).parents[1] / "references" / "geometric_stiffening.json").read_text()
)
HEIGHT = 0.01
UNIT = {"E": 12.0 / HEIGHT**4, "nu": 0.3, "density": 1.0 / HEIGHT**2}  # EI = ρA = L = 1


def blade(stiffening=True, modes=10, elements=20):
    """A beam of unit length, bending stiffness and mass per length."""
    return reduce(
        line(elements, end=(1, 0, 0)), material=UNIT, modes=modes,
        interfaces={"root": "root", "tip": "tip"}, sections={"all": rectangle(HEIGHT, HEIGHT)},
        geometric_stiffening="full" if stiffening else "none",
    )  # fmt: skip


def moments_of_inertia_load(fe, per_mass):
    """Sum of s f^T of forces G s + g per mass."""
    return fe.inertia.S0 @ per_mass[:, :3].T + np.outer(fe.inertia.S1, per_mass[:, 3])


@pytest.mark.parametrize(
    ("load", "offset"),
    [*((load, (0.0, 0.0)) for load in (0, 1, 5, "x", "z")), ("x", (0.1, -0.06)), ("y", (0.1, 0.0))],
)
def test_stress_of_a_load_turns_with_the_body(load, offset):
    """R_v^T K_geo R_w = v.(tr(M) w - M w) of turns v, w and the moments M = sum of s f^T, for loads
    that turn with the body do no work."""
    corners = np.array([[0, 0, 0], [1.0, 0, 0], [1.0, 0.7, 0], [1.0, 0.7, 0.5]])
    places = np.linspace(0, 3, 19)
    points = np.stack([np.interp(places, range(4), corners[:, a]) for a in range(3)], axis=1)
    lines = np.stack([np.arange(18), np.arange(1, 19)], axis=1)
    bent = Mesh(points, {"line": lines}, {"root": np.array([0])})
    material = resolve({"E": 1e9, "nu": 0.3, "density": 1000.0})
    thin = {"all": rectangle(1e-3, 1e-3, shear=False, offset=offset)}
    fe = assemble(bent, material, thin)
    fixed = FixedInterfaceModel(fe, make_interfaces(fe, {"root": "root"}), tuple(range(6)))
    relief = InertiaRelief(fe.M, fe.rigid)
    if isinstance(load, int):
        field, G = centrifugal_fields(fe)[load]
        f, moments = fe.M @ field, np.zeros((3, 3))
    else:
        axis, G, f = "xyz".index(load), np.zeros((3, 3)), np.zeros(fe.numbering.n)
        f[fe.numbering.table[-1, axis]] = 1.0
        moments = np.outer(points[-1], np.eye(3)[axis])
    per_mass = _force_per_mass(fe, G, relief.acceleration(f))
    moments = moments + moments_of_inertia_load(fe, per_mass)
    R = fe.rigid[:, 3:]
    found = R.T @ (geometric_stiffness(fe, fixed.free(relief.loads(f)), per_mass) @ R)
    wanted = np.trace(moments) * np.eye(3) - moments
    np.testing.assert_allclose(found, wanted, atol=0.02 * np.abs(moments).max())


def test_a_rigid_interface_turns_with_the_forces_on_its_nodes():
    """The same of a solid whose end is rigid: what its nodes carry acts at its point."""
    fe = assemble(solid_box("hexahedron20", [3, 1, 1], (1.0, 0.4, 0.3)), resolve("steel"))
    ends = make_interfaces(fe, {"a": "x0", "b": "x1"})
    fixed, relief = FixedInterfaceModel(fe, ends, tuple(range(6))), InertiaRelief(fe.M, fe.rigid)
    for axis in range(3):
        f, turns = fixed.loads()[:, 6 + axis], fe.rigid[:, 3:]
        u = fixed.free(relief.loads(f))
        links = fe.K @ u - relief.loads(f) + f
        found = turns.T @ (geometric_stiffness(fe, u) @ turns)
        found += sum(_rotation_stiffness(fe, end, links) for end in ends)
        per_mass = _force_per_mass(fe, np.zeros((3, 3)), relief.acceleration(f))
        moments = np.outer(ends[1].position, np.eye(3)[axis]) + moments_of_inertia_load(
            fe, per_mass
        )
        wanted = np.trace(moments) * np.eye(3) - moments
        np.testing.assert_allclose(found, wanted, atol=1e-9 * np.abs(moments).max())


def main_frequency(t, y):
    """Of the largest line of a signal [rad/s]."""
    y, n = y - y.mean(), 2**19
    lines = np.abs(np.fft.rfft(y * np.hanning(len(y)), n=n))
    return 2 * np.pi * np.fft.rfftfreq(n, d=t[1] - t[0])[lines.argmax()]


def loaded_frequency(load, ends):
    """Lowest one of a column under a dead load, w'''' + P w'' − ω² w = 0 (Timoshenko, Vibration
    Problems in Engineering, §5.11)."""

    def determinant(omega):
        root = np.sqrt(load**2 / 4 + omega**2)
        a, b = np.sqrt(root - load / 2), np.sqrt(root + load / 2)

        def row(x, n):
            """n-th derivatives of cosh ax, sinh ax, cos bx, sin bx."""
            even = n % 2 == 0
            hyperbolic = (
                (np.cosh(a * x), np.sinh(a * x)) if even else (np.sinh(a * x), np.cosh(a * x))
            )
            turn = b * x + n * np.pi / 2
            return np.array(
                [*(a**n * h for h in hyperbolic), b**n * np.cos(turn), b**n * np.sin(turn)]
            )

        if ends == "pinned":
            rows = [row(0, 0), row(0, 2), row(1, 0), row(1, 2)]
        else:
            ends_free = np.add(row(1, 3), load * np.array(row(1, 1)))
            rows = [row(0, 0), row(0, 1), row(1, 2), ends_free]
        return np.linalg.det(rows)

    grid = np.linspace(0.05, 12.0, 2000)
    values = [determinant(omega) for omega in grid]
    k = np.flatnonzero(np.sign(values[:-1]) != np.sign(values[1:]))[0]
    return brentq(determinant, grid[k], grid[k + 1])


@pytest.mark.parametrize(
    ("ends", "euler"),
    [("pinned", np.pi**2), pytest.param("clamped", np.pi**2 / 4, marks=pytest.mark.slow)],
)
def test_a_column_under_load_vibrates_more_slowly(ends, euler):
    """Under nine tenths of Euler's load, where ω² is a tenth of that without it."""
    load = 0.9 * euler
    model = Model("column")
    model.add_body("column", blade())
    if ends == "clamped":
        model.add_joint("root", "fixed", between=["ground", "column.root"])
    else:
        model.add_marker("ground.end", position=[1, 0, 0])
        model.add_joint("root", "universal", between=["ground", "column.root"], axis="y",
                        second_axis="z")  # fmt: skip
        model.add_joint("tip", "in-line", between=["ground.end", "column.tip"], axis="x")
    model.add_force("load", "force", at="column.tip", value=[-load, 0, 0])
    kick = {"type": "step", "t0": 0.01, "t1": 0.02, "y1": 1e-4}
    model.add_force("kick", "torque", at="column.tip", value=[0, 0, kick])
    model.add_sensor("slope", "orientation", of="column.tip")
    wanted = loaded_frequency(load, ends)
    found = run(model, duration=30 / wanted, outputs=750, accuracy=1e-5, verify=False,
                start="quasi-static")  # fmt: skip
    omega = main_frequency(found.t, found["slope.gamma"])
    assert omega**2 / wanted**2 == pytest.approx(1.0, abs=0.05)


def spinning(speed, stiffening):
    model = Model("blade")
    model.add_body("blade", blade(stiffening), angular_velocity=[0, 0, speed])
    model.add_joint("hub", "revolute", between=["ground", "blade.root"], axis="z")
    model.add_driver("motor", joint="hub", angle=f"{speed}*t")
    model.add_force("kick", "force", at="blade.tip", axes="blade.root", value=[0, 1e-4, 1e-4])
    model.add_sensor("tip", "position", of="blade.tip")
    return model


def test_a_cantilever_vibrates_as_fast_as_its_speed_makes_it():
    """At a speed of 12, 3.4 times its first frequency; without stiffening it folds up."""
    speed = 12.0
    found = run(spinning(speed, True), duration=4.0, outputs=1000, accuracy=1e-5, verify=False)
    t, (x, y, z) = found.t, (found[f"tip.{axis}"] for axis in "xyz")
    c, s = np.cos(speed * t), np.sin(speed * t)
    flap = float(REFERENCE["rotating_cantilever"]["flap"]["12"][0])
    lag = np.sqrt(flap**2 - speed**2)
    assert main_frequency(t, z) == pytest.approx(flap, rel=2e-3)
    assert main_frequency(t, c * y - s * x) == pytest.approx(lag, rel=2e-3)


THICKNESS, WIDTH = 0.05, 0.1  # over the length, of blades of solids and of shells


def solid_blade(size=1.0):
    """A square bar of solids of this length, as stiff as the unit beam beside its mass."""
    mesh = solid_box(
        "hexahedron20", (12, 1, 1), (size, THICKNESS * size, THICKNESS * size),
        shape=lambda x: x - [0, THICKNESS * size / 2, THICKNESS * size / 2],
    )  # fmt: skip
    return {
        "mesh": mesh,
        "material": {"E": 12.0 * (size / THICKNESS) ** 2, "nu": 0.0, "density": 1.0},
    }


def shell_blade(n=20, thickness=0.02):
    """A strip of shells, two wide."""
    i, j = np.indices([n + 1, 3]).reshape(2, -1)
    points = np.stack([i / n, (j / 2 - 0.5) * WIDTH, 0.0 * i], axis=1)
    first = (3 * np.arange(n)[:, None] + np.arange(2)).reshape(-1, 1)
    mesh = Mesh(points, {"quad": first + [0, 3, 4, 1]},
                {"x0": np.arange(3), "x1": 3 * n + np.arange(3)})  # fmt: skip
    material = {"E": 12.0 / thickness**2, "nu": 0.0, "density": 1.0}
    sections = {"all": {"type": "shell", "thickness": thickness}}
    return {"mesh": mesh, "material": material, "sections": sections}


@pytest.mark.parametrize(
    ("made", "place"),
    [
        (solid_blade(), (0.0, 0.0, 0.0)),
        (solid_blade(), (1000.0, 500.0, -700.0)),
        (solid_blade(1e-6), (0.0, 0.0, 0.0)),
        (shell_blade(), (0.0, 0.0, 0.0)),
    ],
    ids=["solids", "solids 1 km away", "solids of a micrometre", "shells"],
)
def test_solids_and_shells_stiffen_like_a_beam_anywhere_and_of_any_size(made, place):
    """At a speed of 5; slender ones differ from Euler's beam by shear and rotary inertia, 0.1 %."""
    speed, made = 5.0, dict(made)
    length = float(np.ptp(made["mesh"].points[:, 0]))
    body = reduce(made.pop("mesh"), modes=6, interfaces={"root": "x0", "tip": "x1"},
                  geometric_stiffening="full", **made)  # fmt: skip
    model = Model("blade")
    model.add_marker("ground.hub", position=list(place))
    model.add_body("blade", body, position=list(place), angular_velocity=[0, 0, speed])
    model.add_joint("hub", "revolute", between=["ground.hub", "blade.root"], axis="z")
    model.add_driver("motor", joint="hub", angle=f"{speed}*t")
    kick = body.mass * length * 1e-4
    model.add_force("kick", "force", at="blade.tip", value=[0, 0, kick])
    model.add_sensor("tip", "position", of="blade.tip")
    found = run(model, duration=6.0, outputs=800, accuracy=1e-5, verify=False)
    flap = float(REFERENCE["rotating_cantilever"]["flap"]["5"][0])
    assert main_frequency(found.t, found["tip.z"]) == pytest.approx(flap, rel=3e-3)


def test_a_spin_up_bends_a_blade_as_a_ritz_model_says():
    """Kane, Ryan & Banerjee's manoeuvre, planar, beside modes of stretch and foreshortening."""
    of, law = (
        REFERENCE["spin_up"]["params"],
        "{Os}/{Ts}*(t**2/2-({Ts}/(2*pi))**2*(1-cos(2*pi*t/{Ts})))",
    )
    E = 7e10
    area, inertia = of["EA"] / E, of["EI"] / E
    body = reduce(
        line(20, end=(of["L"], 0, 0)), material={"E": E, "nu": 0.3, "density": of["rA"] / area},
        modes=8, interfaces={"root": "root", "tip": "tip"}, geometric_stiffening="full",
        sections={"all": general(A=area, Iy=inertia, Iz=inertia, J=2 * inertia)},
    )  # fmt: skip
    model = Model("spin-up", plane="xy")
    model.add_body("blade", body)
    model.add_joint("hub", "revolute", between=["ground", "blade.root"], axis="z")
    model.add_driver("motor", joint="hub", angle=law.format(**of))
    model.add_sensor("tip", "position", of="blade.tip")
    wanted = {float(t): v for t, v in REFERENCE["spin_up"]["tip_deflection"].items()}
    times = [0.0, *sorted(wanted)]
    found = run(model, duration=15.0, outputs=times, accuracy=1e-4)
    t, x, y = found.t, found["tip.x"], found["tip.y"]
    angle = of["Os"] / of["Ts"] * (
        t**2 / 2 - (of["Ts"] / (2 * np.pi)) ** 2 * (1 - np.cos(2 * np.pi * t / of["Ts"]))
    )  # fmt: skip
    deflection = np.cos(angle) * y - np.sin(angle) * x
    largest = max(abs(v) for v in wanted.values())
    for time, value in zip(t[1:], deflection[1:], strict=True):
        assert value == pytest.approx(wanted[round(float(time), 6)], abs=3e-3 * largest)
    stretch = np.cos(angle[-1]) * x[-1] + np.sin(angle[-1]) * y[-1] - of["L"]
    assert stretch == pytest.approx(REFERENCE["spin_up"]["mean_stretch_afterwards"], rel=0.01)


def test_energy_is_kept_by_a_free_blade_that_tumbles():
    model = Model("free blade")
    model.add_body("blade", blade(modes=4), angular_velocity=[0.3, 0.5, 2.0])
    model.add_sensor("tip", "position", of="blade.tip")
    found = run(model, duration=5.0, accuracy=1e-8, method="explicit-rk", verify=False)
    total = found.energy[:, :3].sum(axis=1)
    assert np.ptp(total) < 1e-6 * total[0]


def test_without_an_interface_it_is_refused():
    with pytest.raises(ReductionError, match="geometric_stiffening: needs at least one interface"):
        reduce(line(4), material="steel", sections={"all": rectangle(0.01, 0.01)}, modes=2,
               geometric_stiffening="full")  # fmt: skip
