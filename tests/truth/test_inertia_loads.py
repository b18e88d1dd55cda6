"""Growth and stress of bodies under their own inertia, with few modes, against closed forms.

Timoshenko & Goodier, Theory of Elasticity, 3rd ed., §32: rotating discs; bars under their own
centrifugal force by integrating σ' = −ρ Ω² r; beams under ρ A α x by integrating EI w'''' = p.
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line, solid_box
from truthkit import run

import flexmb
from flexmb.errors import ReductionError
from flexmb.fe import assemble, rectangle, reduce, resolve
from flexmb.fe.reduction.inertia_relief import inertia_loads
from flexmb.flexbody.static_response import InertiaResponse
from flexmb.model import Model

STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7850.0}
E, NU, RHO = STEEL["E"], STEEL["nu"], STEEL["density"]
NONE = np.zeros((1, 3))


def equilibrium(body, alpha=NONE, omega=NONE):
    """eta of a free body that turns steadily, or is turned about its origin ever faster."""
    w, e = np.ravel(omega), np.ravel(alpha)
    turn = np.cross(np.eye(3), -e) + np.outer(w, w) - w @ w * np.eye(3)
    return np.linalg.solve(body.K, -np.einsum("bc,cbm->m", turn, body.P))


def radial_growth(body, eta, radius):
    x = body.nodes.position
    r = np.hypot(x[:, 0], x[:, 1])
    u = np.einsum("kbm,m->kb", body.nodes.Phi_t, eta)
    return np.mean(np.sum(u * x, axis=1)[(there := np.isclose(r, radius))] / r[there])


def disc(size=1.0, inner=0.1, elements="quad", **options):
    mesh = {"type": "disk", "radius": 0.4 * size, "inner": inner * size, "elements": elements,
            "divisions": [8, 48] if elements == "quad" else [6, 32, 1]}  # fmt: skip
    if elements == "quad":
        options["sections"] = {"all": {"type": "shell", "thickness": 0.01 * size}}
    else:
        mesh["thickness"] = 0.01 * size
    return reduce(mesh, material=STEEL, residual="inertia", **options)


@pytest.mark.parametrize("elements", ["quad", "hexahedron20"])
@pytest.mark.parametrize(("modes", "size"), [(0, 1.0), (20, 1.0), (3, 1e-6)])
def test_a_spinning_disc_grows_and_is_stressed(elements, modes, size):
    speed, a, b = 300.0 / size, 0.1 * size, 0.4 * size
    body = disc(size, elements=elements, modes=modes)
    eta = equilibrium(body, omega=[[0, 0, speed]])

    def growth(r):
        c = a * a + b * b + (1 + NU) / (1 - NU) * (a * b / r) ** 2 - (1 + NU) / (3 + NU) * r * r
        return (3 + NU) * (1 - NU) / (8 * E) * RHO * speed**2 * r * c

    bore = (3 + NU) / 4 * RHO * speed**2 * (b * b + (1 - NU) / (3 + NU) * a * a)
    stress = np.tensordot(body.stress.modes.astype(float), eta, axes=(2, 0))
    polygon = 1e-2 if elements == "quad" else 2e-3  # of straight edges
    assert radial_growth(body, eta, b) == pytest.approx(growth(b), rel=polygon)
    assert radial_growth(body, eta, a) == pytest.approx(growth(a), rel=2e-2)
    assert stress[:, :2].max() == pytest.approx(bore, rel=0.03)
    assert max(body.inertia_response.missing_shares.values()) < 1e-6


def bar(residual="inertia", modes=2, size=1.0, elements=10, reduction="craig-bampton", **options):
    return reduce(
        line(elements, end=(size, 0, 0)), material=STEEL, modes=modes, residual=residual,
        interfaces={"root": "root"}, sections={"all": rectangle(0.02 * size, 0.02 * size)},
        reduction=reduction, **options,
    )  # fmt: skip


@pytest.mark.seconds
def test_a_disc_that_a_driver_turns_on_a_carriage_grows():
    """ρ Ω² b ((1 − ν) b² + (3 + ν) a²)/4E at the rim: the driver stands between two bodies."""
    speed, a, b = 300.0, 0.1, 0.4
    model = Model("disc on a carriage")
    model.add_body("carriage", mass=5.0, inertia=[1, 1, 1])
    mesh = {"type": "disk", "radius": b, "inner": a, "thickness": 0.01, "divisions": [6, 32, 1]}
    model.add_body("disc", mesh=mesh, material=STEEL, modes=4, stress="none",
                   interfaces={"hub": {"group": "inner", "type": "rbe3"}},
                   markers={"rim": {"position": [b, 0, 0]}, "other": {"position": [-b, 0, 0]}},
                   )  # fmt: skip
    model.add_joint("rail", "prismatic", between=["ground", "carriage"], axis="x")
    model.add_joint("spindle", "revolute", between=["carriage", "disc.hub"], axis="z")
    model.add_driver("motor", joint="spindle", angle=f"{speed}*t")
    model.add_sensor("wide", "distance", between=["disc.rim", "disc.other"])
    model.set_dynamics(duration=1e-3, outputs=5, accuracy=1e-4, start="quasi-static", verify=False)
    wide = flexmb.simulate(model)["wide"]
    growth = RHO * speed**2 * b * ((1 - NU) * b * b + (3 + NU) * a * a) / (4 * E)
    assert wide[-1] / 2 - b == pytest.approx(growth, rel=0.01)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (1000.0, -300.0, 500.0)])
@pytest.mark.parametrize("size", [1.0, 1e-6])
@pytest.mark.parametrize("reduction", ["craig-bampton", "free-interface", "guyan"])
def test_a_bar_on_a_hub_stretches(place, size, reduction):
    """Both ends of the run: u(L) = ρ Ω² L³ / 3 E, N(0) = ρ A Ω² L² / 2; the hub is at its root."""
    speed, L, A = 100.0 / size, size, (0.02 * size) ** 2
    model = Model("bar")
    model.add_marker("ground.hub", position=place)
    body = bar(modes=0, size=size, reduction=reduction)
    model.add_body("bar", body, position=place, angular_velocity=[0, 0, speed])
    model.add_marker("bar.tip", node=10)
    model.add_joint("hub", "revolute", between=["ground.hub", "bar.root"], axis="z")
    model.add_driver("motor", joint="hub", angle=f"{speed}*t")
    model.add_sensor("tip", "position", of="bar.tip", relative_to="bar.root")
    found = run(model, duration=0.01 * size, start="quasi-static", accuracy=1e-5, verify=False)
    stretch = np.linalg.norm([found[f"tip.{axis}"][-1] for axis in "xyz"]) - L
    rounding = 1e-9 * L + 4e-16 * np.linalg.norm(place)
    wanted = RHO * speed**2 * L**3 / (3 * E)
    assert stretch == pytest.approx(wanted, rel=3e-3, abs=rounding)
    eta = found.q[-1, 7 : 7 + body.m]
    force = body.section_forces.modes[0, 0, 0] @ eta  # of the first of ten elements
    assert force == pytest.approx(RHO * A * speed**2 * L**2 / 2, rel=0.01)


def test_a_beam_that_is_turned_ever_faster_bends():
    """By 11 p L⁴ / 120 EI at its tip, under p = ρ A α x / L that rises from zero at the hub."""
    L, height, alpha = 1.0, 0.02, 10.0
    body = bar(modes=0)
    root, tip = body.interface("root"), body.nodes.Phi_t[np.argmax(body.nodes.position[:, 0])]
    load = np.einsum("bc,cbm->m", np.cross(np.eye(3), [0, 0, -alpha]), body.P)
    # the root is held: six rows over the frame and eta, and the frame turns with alpha
    arm = np.cross(np.eye(3), root.position)
    G = np.block([[np.eye(3), arm, root.Phi_t], [np.zeros((3, 3)), np.eye(3), root.Phi_r]])
    n = G.shape[1]
    K = np.zeros((n + 6, n + 6))
    K[6:n, 6:n], K[:n, n:], K[n:, :n] = body.K, G.T, G
    c = body.center
    moment = np.array([0, 0, alpha * (np.trace(body.S0) - body.S0[2, 2])])
    right = np.concatenate([-body.mass * np.cross([0, 0, alpha], c), -moment, -load, np.zeros(6)])
    x = np.linalg.solve(K, right)[:n]
    moved = x[:3] + np.cross(x[3:6], [L, 0, 0]) + tip @ x[6:]
    stiffness = E * height**4 / 12
    wanted = -11 * RHO * height**2 * alpha * L * L**4 / (120 * stiffness)
    shear = 1 + 5e-3
    assert moved[1] == pytest.approx(wanted * shear, rel=5e-3)


@pytest.mark.seconds
@pytest.mark.parametrize("modes", [10, 60])
def test_a_spinning_disc_of_a_scene_grows_whatever_its_modes(modes):
    """Of 60 modes one grows, and lacks 9 % of the response: growth was 3.4 % too small."""
    a, b, speed = 0.05, 0.3, -500.0
    model = Model("disc")
    mesh = {"type": "disk", "radius": b, "inner": a, "thickness": 0.02, "divisions": [8, 32, 1]}
    model.add_body(
        "disc", mesh=mesh, material=STEEL, modes=modes, angular_velocity=[0, 0, speed],
        interfaces={"hub": {"group": "inner", "type": "rbe3"}},
    )  # fmt: skip
    for name, place in (("east", b), ("west", -b)):
        model.add_marker(f"disc.{name}", position=[place, 0, 0])
    model.add_joint("bearing", "revolute", between=["ground", "disc.hub"], axis="z")
    model.add_sensor("diameter", "distance", between=["disc.east", "disc.west"])
    found = flexmb.simulate(model, duration=1e-3, start="quasi-static", outputs=4)
    rim = RHO * speed**2 / 4 * ((1 - NU) * b * b + (3 + NU) * a * a)  # hoop stress there
    assert found["diameter"][-1] - 2 * b == pytest.approx(2 * b * rim / E, rel=3e-3)


def test_without_them_the_report_says_that_the_body_cannot():
    """A free disc of twenty modes has none in which it grows."""
    mesh = {"type": "disk", "radius": 0.4, "inner": 0.1, "divisions": [6, 32]}
    sections = {"all": {"type": "shell", "thickness": 0.01}}
    for residual, share in (("none", 1.0), ("inertia", 0.0)):
        body = reduce(mesh, material=STEEL, sections=sections, modes=20, residual=residual)
        spin = body.inertia_response.missing_shares["spin about z"]
        assert spin == pytest.approx(share, abs=1e-6)


def test_words_that_are_none():
    with pytest.raises(ReductionError, match='residual: unknown "inertial"'):
        bar("inertial")
    with pytest.raises(ReductionError, match="residual: user modes take no residual vectors"):
        bar(modes=np.eye(66)[:, 30:31], reduction="user")


def test_factors_of_the_fields_are_those_of_a_rigid_motion():
    """Mass times a + alpha x s + omega x (omega x s) of every node, by twelve loads of a body."""
    fe = assemble(solid_box("hexahedron20", [2, 1, 1], (1.0, -0.4, 0.7)), resolve(STEEL))
    a, alpha, omega = np.random.default_rng(4).normal(size=(3, 3))
    (c,) = InertiaResponse.factors(a[None], alpha[None], omega[None])
    s = fe.mesh.points - fe.center
    wanted = a + np.cross(alpha, s) + np.cross(omega, np.cross(omega, s))
    field = np.zeros(fe.numbering.n)
    field[fe.numbering.table[:, :3]] = wanted
    loads = fe.M @ field
    np.testing.assert_allclose(inertia_loads(fe) @ c, loads, atol=1e-13 * np.abs(loads).max())


@pytest.mark.slow
@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (1000.0, 500.0, -700.0)])
def test_a_shaken_bar_is_stressed_as_its_inertia_bends_it(place):
    """rho a (L - x)^2/2 times y over the second moment of the section, away from the clamp."""
    L, h, a, rho = 1.0, 0.02, 50.0, 7800.0
    mesh = solid_box("hexahedron20", (20, 1, 1), (L, h, h), shape=lambda x: x - [0, h / 2, h / 2])
    bar = reduce(mesh, material={"E": 2e11, "nu": 0.0, "density": rho}, modes=4,
                 interfaces={"root": "x0"}, residual="inertia")  # fmt: skip
    model = Model("shaken")
    model.add_marker("ground.rail", position=list(place))
    model.add_body("bar", bar, position=list(place))
    model.add_joint("slide", "prismatic", between=["ground.rail", "bar.root"], axis="y")
    model.add_driver("push", joint="slide", stroke=f"{a}*t**2/2")
    found = run(model, duration=0.02, outputs=5, accuracy=1e-6, verify=False, start="quasi-static")
    stress = bar.stress.modes[:, 0].astype(float) @ found.q[-1, 7 : 7 + bar.m]
    x, y, _ = mesh.points[bar.stress.ids].T
    wanted = 6 * rho * a * (L - x) ** 2 / h**2 * y
    error = np.abs(stress - wanted)[x > 0.1]
    assert error.max() < 1e-3 * np.abs(wanted).max()
