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
from flexmb.fe import (  # fmt: skip
    Mesh,
    assemble,
    general,
    make_interfaces,
    mesh_from,
    part,
    rectangle,
    reduce,
    resolve,
    shell,
)
from flexmb.fe.assembly.assemble import geometric_stiffness
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.fe.reduction.geometric_stiffening import _acceleration, interface_stiffness
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


BENT = np.array([[0, 0, 0], [1.0, 0, 0], [1.0, 0.7, 0], [1.0, 0.7, 0.5]])
SKEW = np.linalg.qr([[0.9, 0.1, 0.4], [0.3, 0.8, -0.2], [0.1, 0.5, 0.7]])[0]
THIN = {"all": rectangle(1e-3, 1e-3, shear=False)}
MASS = {"mass": 5.0, "offset": [0.1, 0.3, -0.2], "inertia": [0.3, 0.2, 0.1]}


def bent_line(offset=(0.0, 0.0)):
    """Beams around two corners, clamped at one end, loaded at the other."""
    points = np.stack([np.interp(np.linspace(0, 3, 19), range(4), c) for c in BENT.T], axis=1)
    lines = np.stack([np.arange(18), np.arange(1, 19)], axis=1)
    mesh = Mesh(points, {"line": lines}, {"root": np.array([0])})
    return mesh, {"sections": {"all": rectangle(1e-3, 1e-3, shear=False, offset=offset)}}


def with_mass(**options):
    mesh, more = bent_line()
    return mesh, {**more, "masses": {"m": {"at": 18, **MASS}}, **options}


def tied_lines():
    """Two beams and a rigid arm between them, with a body on the far end of the arm."""
    one, other = line(12, end=(1, 0.2, 0.1)), line(6, start=(1.3, 0.5, 0.1), end=(2, 0.5, 0.3))
    lines = np.vstack([one.blocks["line"], other.blocks["line"] + 13])
    groups = {"root": np.array([0]), "c": np.array([13])}
    mesh = Mesh(np.vstack([one.points, other.points]), {"line": lines}, groups)
    ties = {"arm": {"type": "rbe2", "reference": 12, "nodes": "c"}}
    return mesh, {"sections": THIN, "ties": ties, "masses": {"m": {"at": 13, **MASS}}}


def sprung_lines():
    """The same with springs in place of the arm."""
    mesh, options = tied_lines()
    axes = [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]]
    springs = {
        "six": {"between": [12, 13], "stiffness": [10.0, 20.0, 30.0, 4.0, 5.0, 6.0], "axes": axes},
        "line": {"between": [11, 15], "stiffness": 7.0},
    }
    return mesh, {**options, "ties": {}, "springs": springs}


def block_and_line(kind):
    """A beam that is tied to the face of a solid, beside its middle."""
    block, bar = solid_box("hexahedron20", [2, 1, 1], (1.0, 0.4, 0.3)), line(4, (1.2, 0.5, 0.1))
    first, bar_points = len(block.points), bar.points + [0.1, 0.4, 0.2]
    groups = {"root": block.group_nodes("x0", ""), "x1": block.group_nodes("x1", "")}
    blocks = {**block.blocks, "line": bar.blocks["line"] + first}
    mesh = Mesh(np.vstack([block.points, bar_points]), blocks, groups)
    ties = {"t": {"type": kind, "reference": first, "nodes": "x1"}}
    return mesh, {"sections": {"all": rectangle(0.03, 0.02)}, "ties": ties}


def skew_plate(kind, offset):
    mesh = mesh_from(
        {"type": "plate", "length": 1, "width": 0.3, "divisions": [6, 2], "elements": kind}
    )
    groups = {"root": mesh.group_nodes("x0", "")}
    mesh = Mesh(mesh.points @ SKEW.T, mesh.blocks, groups)
    return mesh, {"sections": {"all": shell(0.01, offset=offset)}}


def turning_work(fe, ends, load):
    """R_v^T K_geo R_w of turns v, w under a load, and tr(M) I - M with its moments sum of s f^T.

    A load is a centrifugal field, by number, a force along an axis at the last node, or one at the
    last interface.
    """
    fixed, relief = FixedInterfaceModel(fe, ends, tuple(range(6))), InertiaRelief(fe.M, fe.rigid)
    f, field, moments = np.zeros(fe.numbering.n), np.zeros((3, 4)), np.zeros((3, 3))
    at_end = 0.0
    if isinstance(load, int):
        f, field = centrifugal_fields(fe)[load]
    elif load[0] == "i":
        axis = "xyz".index(load[1])
        f = at_end = fixed.loads()[:, axis - 6]
        moments = np.outer(ends[-1].position, np.eye(3)[axis])
    else:
        axis = "xyz".index(load)
        f[fe.numbering.table[-1, axis]] = 1.0
        moments = np.outer(fe.mesh.points[-1], np.eye(3)[axis])
    field = field - _acceleration(fe, relief.acceleration(f))
    moments = moments + fe.inertia.S0 @ field[:, :3].T + np.outer(fe.inertia.S1, field[:, 3])
    u, turns = fixed.free(relief.loads(f)), fe.rigid[:, 3:]
    found = turns.T @ (geometric_stiffness(fe, u, field) @ turns)
    links = fe.K @ u - relief.loads(f) + at_end
    found += sum(interface_stiffness(fe, end, links) for end in ends)
    return found, np.trace(moments) * np.eye(3) - moments


@pytest.mark.parametrize(
    ("made", "error"),
    [
        (bent_line(), 3e-3),
        (bent_line((0.1, -0.06)), 0.02),
        (with_mass(), 3e-3),
        (with_mass(mass_matrix="hrz"), 1e-9),
        (tied_lines(), 1e-3),
        (sprung_lines(), 3e-3),
        (block_and_line("rbe2"), 1e-3),
        (block_and_line("rbe3"), 1e-3),
        (skew_plate("quad", 0.0), 6e-3),
        (skew_plate("quad", 0.05), 6e-3),
        (skew_plate("triangle", 0.05), 6e-3),
    ],
    ids=[
        "beams", "beams beside their nodes", "mass on an arm", "lumped mass", "rigid arm",
        "springs", "rbe2 face", "rbe3 face", "quads", "quads beside their nodes", "triangles",
    ],
)  # fmt: skip
def test_stress_of_a_load_turns_with_the_body(made, error):
    """Loads that turn with the body do no work: of turns v, w it is v.(tr(M) w - M w)."""
    mesh, options = made
    material = resolve({"E": 1e9, "nu": 0.3, "density": 1000.0})
    fe = assemble(mesh, material, **options)
    ends = make_interfaces(fe, {"root": "root"})
    for load in (0, 1, 5, "x", "y", "z"):
        found, wanted = turning_work(fe, ends, load)
        np.testing.assert_allclose(found, wanted, atol=error * np.abs(wanted).max())


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
def test_an_interface_turns_with_the_forces_on_its_nodes(kind):
    """The same of a solid with an interface beside its end: what its nodes carry acts there."""
    fe = assemble(solid_box("hexahedron20", [3, 1, 1], (1.0, 0.4, 0.3)), resolve("steel"))
    tip = {"group": "x1", "type": kind, "position": [1.3, 0.7, 0.2]}
    ends = make_interfaces(fe, {"a": "x0", "b": tip})
    for load in ("ix", "iy", "iz", 1):
        found, wanted = turning_work(fe, ends, load)
        np.testing.assert_allclose(found, wanted, atol=1e-9 * np.abs(wanted).max())


def spinning_arm(mass, EI, beam, arm, hub, speed):
    """Frequency [rad/s] of a mass on a rigid arm on a beam without mass, out of the plane of
    rotation. Of the beam EI times the fourth derivative of w is N times the second; at its end
    the moment is r (1 - N dw/dx), the force 1."""
    N = mass * speed**2 * (hub + beam + arm)
    k = np.sqrt(N / EI)

    def row(x, n):
        """n-th derivatives of 1, x, cosh kx, sinh kx."""
        waves = [np.cosh(k * x), np.sinh(k * x)][:: 1 if n % 2 == 0 else -1]
        return np.array([float(n == 0), [x, 1.0, 0.0, 0.0][n], *(k**n * v for v in waves)])

    rows = [row(0, 0), row(0, 1), EI * row(beam, 2) + arm * N * row(beam, 1)]
    rows.append(N * row(beam, 1) - EI * row(beam, 3))
    shape = np.linalg.solve(rows, [0.0, 0.0, arm, 1.0])
    return 1 / np.sqrt(mass * (row(beam, 0) + arm * row(beam, 1)) @ shape)


@pytest.mark.parametrize("kind", ["tie", "offset"])
def test_a_mass_on_a_rigid_arm_spins(kind):
    """Its arm, a tie or an offset, is stretched like a pendulum's string."""
    beam, arm, hub, mass, speed, h = 0.2, 0.5, 0.3, 2.0, 40.0, 0.01
    bar = line(8, end=(beam, 0, 0))
    groups = {"root": np.array([0]), "tip": np.array([8])}
    mesh = Mesh(np.vstack([bar.points, [beam + arm, 0, 0]]), bar.blocks, groups)
    held = {"at": 8, "mass": mass, "offset": [arm, 0, 0]}
    ties = {}
    if kind == "tie":
        ties, held = (
            {"t": {"type": "rbe2", "reference": 9, "nodes": "tip"}},
            {"at": 9, "mass": mass},
        )
    found = part(
        mesh, material={"E": 7e10, "nu": 0.3, "density": 1e-3}, ties=ties, masses={"m": held},
        sections={"all": rectangle(h, h, shear=False)}, frequencies=2, preload=True,
        supports={"hub": {"group": "root", "type": "clamped"}},
        loads={"s": {"type": "spin", "angular_velocity": [0, 0, speed], "position": [-hub, 0, 0]}},
    ).frequencies  # fmt: skip
    flap = spinning_arm(mass, 7e10 * h**4 / 12, beam, arm, hub, speed)
    lag = np.sqrt(flap**2 - speed**2)  # in the plane, without Coriolis forces
    assert 2 * np.pi * found == pytest.approx([lag, flap], rel=2e-4)


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
def test_a_column_with_a_rigid_end_buckles(kind):
    """Pressed at the end of a rigid extension a: tan kL = 1/(k a), P = EI k^2."""
    h, a, E = 0.02, 0.3, 2e11
    mesh = solid_box("hexahedron20", (12, 1, 1), (1.0, h, 1.5 * h))
    tip = {"group": "x1", "type": kind, "position": [1.0 + a, h / 2, 0.75 * h]}
    load = {"type": "interface", "interface": "tip", "force": [-1.0, 0, 0]}
    factors = part(
        mesh, material={"E": E, "nu": 0.0, "density": 7800.0}, interfaces={"tip": tip},
        supports={"root": {"group": "x0", "type": "clamped"}}, loads={"p": load}, buckling=1,
    ).load_factors  # fmt: skip
    k = brentq(lambda k: np.cos(k) - k * a * np.sin(k), 0.1, np.pi / 2)
    assert factors[0] == pytest.approx(E * 1.5 * h**4 / 12 * k**2, rel=2e-3)


def test_shells_beside_their_nodes_stiffen_like_those_on_them():
    """With rigid ends the plate is the same, wherever its nodes are."""
    size = {"type": "plate", "length": 1, "width": 0.3, "divisions": [6, 2]}
    bodies = []
    for offset in (0.0, 0.04):
        plate = mesh_from(size)
        ends = {k: plate.group_nodes(f"x{k}", "") for k in (0, 1)}
        mesh = Mesh(
            plate.points - [0, 0, offset], plate.blocks, {f"x{k}": v for k, v in ends.items()}
        )
        interfaces = {f"x{k}": {"group": f"x{k}", "position": [k, 0.1, 0.2]} for k in (0, 1)}
        sections = {"all": shell(0.01, offset=offset)}
        bodies.append(reduce(mesh, material="steel", sections=sections, interfaces=interfaces,
                             modes=2, geometric_stiffening="full"))  # fmt: skip
    for forms in zip(*([b.centrifugal_stiffness[0, 0], b.centrifugal_stiffness[0, 1],
                        *b.interfaces[1].bend[:3], b.interfaces[1].bend[3:].sum(axis=0)]
                       for b in bodies), strict=True):  # fmt: skip
        one, other = (np.linalg.eigvalsh(form) for form in forms)
        np.testing.assert_allclose(other, one, atol=1e-6 * np.abs(one).max())


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


@pytest.mark.parametrize(("ends", "euler"), [("pinned", np.pi**2), ("clamped", np.pi**2 / 4)])
@pytest.mark.slow
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


@pytest.mark.seconds
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
