"""State space and frequency responses against modal sums and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line
from restscenes import FAR, G, chain, pendulum

import flexmb
from flexmb.errors import SceneError
from flexmb.fe import rectangle, reduce
from flexmb.model import Model


def with_ends(n=4, **fields):
    made = chain(n, **fields)
    made.add_force("push", "force", at="m0", value=[0.0, 0, 0])
    made.add_force("piston", "line-force", between=["m0", "m2"], value=0.0)
    for i in range(n):
        made.add_sensor(f"m{i}", "position", of=f"m{i}")
    made.add_sensor("speed", "velocity", of="m3")
    made.add_sensor("acceleration", "acceleration", of="m3")
    made.add_sensor("guide", "reaction", joint="guide0", on="J", quantity="moment")
    return made


def modal_sum(n, k, c, m, force, at, s):
    """Σ φ_a φ_f/(m_j (s² + 2 ζ ω s + ω²)) of a chain between walls."""
    j = np.arange(1, n + 1)
    omega = 2 * np.sqrt(k / m) * np.sin(j * np.pi / (2 * n + 2))
    shapes = np.sqrt(2 / (n + 1) / m) * np.sin(np.outer(np.arange(1, n + 1), j) * np.pi / (n + 1))
    return sum(
        shapes[at, i] * (shapes[:, i] @ force) / (s**2 + c / k * omega[i] ** 2 * s + omega[i] ** 2)
        for i in range(n)
    )


def test_responses_of_a_chain_are_modal_sums():
    n, k, c, m = 4, 300.0, 1.5, 2.0
    made = flexmb.linearize(with_ends(n, k=k, c=c, m=m))
    f = np.linspace(0.1, 6.0, 25)
    s = 2j * np.pi * f
    forces = {"push.x": np.array([1.0, 0, 0, 0]), "piston": np.array([-1.0, 0, 1.0, 0])}
    for name, force in forces.items():
        wanted = modal_sum(n, k, c, m, force, 3, s)
        for channel, factor in (("m3.x", 1.0), ("speed.x", s), ("acceleration.x", s**2)):
            found = made.frequency_response(name, channel, f)
            np.testing.assert_allclose(found, factor * wanted, rtol=1e-8)
    import scipy.signal  # a second to load

    space = made.state_space(["push.x", "piston"], ["m3.x", "acceleration.x"])
    system = scipy.signal.StateSpace(*space[:4])
    for i, force in enumerate(forces.values()):
        for o, factor in enumerate((1.0, s**2)):
            a, b, c_, d = space.A, space.B[:, i], space.C[o], space.D[o, i]
            found = [c_ @ np.linalg.solve(one * np.eye(len(a)) - a, b) + d for one in s]
            np.testing.assert_allclose(
                found, factor * modal_sum(n, k, c, m, force, 3, s), rtol=1e-7
            )
    poles = np.sort_complex(np.linalg.eigvals(system.A))
    both = np.concatenate([made.eigenvalues, made.eigenvalues.conj()])
    np.testing.assert_allclose(poles, np.sort_complex(both), rtol=1e-8)


@pytest.mark.parametrize("place", [(0, 0, 0), FAR])
def test_pendulum_on_a_shaken_pin(place):
    """(J + m l²) θ̈ + m g l θ = −m l ü; the pin's force is m (ü + l θ̈)."""
    made = pendulum(0.0, place)
    made.joints.clear()
    made.add_body("cart", mass=1.0, inertia=[1, 1, 1], position=list(place))
    made.add_joint("rail", "prismatic", between=["ground.pin", "cart"], axis="x")
    made.add_joint("pin", "revolute", between=["cart", "bar"], axis="z")
    made.add_driver("shake", joint="rail", stroke="0.2*sin(t)")
    made.add_sensor("turn", "angle", joint="pin")
    made.add_sensor("pull", "reaction", joint="pin", on="J", axes="global")
    made.add_sensor("drive", "reaction", driver="shake", on="J", axes="global")
    made = flexmb.linearize(made, frame="ground")
    m, l, J = 2.0, 0.5, 0.3  # noqa: E741
    f = np.array([0.1, 0.4, 0.9, 3.0])
    s = 2j * np.pi * f
    theta = -m * l * s**2 / ((J + m * l * l) * s**2 + m * G * l)
    np.testing.assert_allclose(made.frequency_response("shake", "turn", f), theta, rtol=1e-7)
    pull = m * (s**2 + l * s**2 * theta)
    np.testing.assert_allclose(made.frequency_response("shake", "pull.x", f), pull, rtol=1e-6)
    drive = made.frequency_response("shake", "drive.x", f)
    np.testing.assert_allclose(drive, pull + 1.0 * s**2, rtol=1e-6)
    space = made.state_space(["shake"], ["turn"])
    assert space.inputs == ("shake''",)
    found = [
        one**2
        * (space.C @ np.linalg.solve(one * np.eye(len(space.A)) - space.A, space.B) + space.D)
        for one in s
    ]
    np.testing.assert_allclose(np.array(found)[:, 0, 0], theta, rtol=1e-7)


def test_response_of_a_flexible_cantilever_is_its_modal_sum():
    """Of the reduced body with its root held: Φᵀ (K − ω² M)⁻¹ Φ at the tip."""
    beam = reduce(
        line(20, end=(1, 0, 0)), modes=8, interfaces={"root": "root", "tip": "tip"},
        material="steel", sections={"all": rectangle(0.02, 0.01)},
    )  # fmt: skip
    model = Model("beam")
    model.add_body("beam", beam)
    model.add_joint("root", "fixed", between=["ground", "beam.root"])
    model.add_force("push", "force", at="beam.tip", value=[0.0, 0.0, 0.0])
    model.add_sensor("tip", "position", of="beam.tip")
    made = flexmb.linearize(model)
    f = np.linspace(1.0, 200.0, 9)
    shapes, rates = made.shapes, np.abs(made.eigenvalues)
    masses = np.einsum("ik,ij,jk->k", shapes, made.M, shapes).real
    tip = made.state_space(["push.z"], ["tip.z"])
    n = tip.A.shape[0] // 2
    near = next(part for part in beam.interfaces if part.name == "tip")
    arm = np.asarray(near.position)  # z of δr + δθ × s + Φ η, all axes at rest
    column = np.concatenate([[0, 0, 1], [arm[1], -arm[0], 0], near.Phi_t[2]])
    for one in 2 * np.pi * f:
        found = tip.C @ np.linalg.solve(1j * one * np.eye(2 * n) - tip.A, tip.B)
        wanted = np.sum((column @ shapes) ** 2 / masses / (rates**2 - one**2))
        assert found[0, 0] == pytest.approx(wanted, rel=1e-6)


def test_unknown_names_are_refused_with_the_nearest():
    made = flexmb.linearize(with_ends())
    with pytest.raises(SceneError, match=r"push\.x"):
        made.state_space(["push.xx"])
    with pytest.raises(SceneError, match=r"m3\.x"):
        made.frequency_response("push.x", "m3.xx", [1.0])


def test_a_bead_on_a_spoke_feels_how_the_wheel_is_turned():
    """δr̈ + (k/m − ω²) δr = 2 r ω δφ̇ from the wheel; from the ground x = r cos φ has what follows
    by its derivatives, the spoke being oblique just now."""
    m, k, w, r, phi = 2.0, 500.0, 6.0, 0.5, 0.4
    c, s = np.cos(phi), np.sin(phi)
    turned = {"orientation": {"axis": "z", "angle": f"{phi} rad"}}
    model = Model("wheel", plane="xy")
    model.add_body("wheel", mass=1.0, inertia=[1, 1, 1], **turned)
    model.add_body("bead", mass=m, inertia=[1, 1, 1], position=[r * c, r * s, 0], **turned,
                   velocity=[-r * w * s, r * w * c, 0], angular_velocity=[0, 0, w])  # fmt: skip
    model.add_joint("axle", "revolute", between=["ground", "wheel"], axis="z")
    model.add_joint("spoke", "prismatic", between=["wheel", "bead"], axis=[c, s, 0])
    model.add_driver("motor", joint="axle", angle=f"{w}*t")
    model.add_force("spring", "bushing", between=["wheel", "bead"], stiffness=[k, 0, 0],
                    preload=[-m * r * w * w, 0, 0])  # fmt: skip
    for kind in ("position", "velocity"):
        model.add_sensor(kind, kind, of="bead", relative_to="wheel", axes="wheel")
    made = flexmb.linearize(model, frame="wheel")
    hertz = np.array([0.5, 1.5, 4.0])
    rate = 2j * np.pi * hertz
    wanted = 2 * r * w * rate / (rate**2 + k / m - w * w)
    for name, factor in (("position.x", 1.0), ("velocity.x", rate)):
        found = made.frequency_response("motor", name, hertz)
        np.testing.assert_allclose(found, factor * wanted, rtol=1e-6, err_msg=name)
    with pytest.warns(match="not steady"):
        ground = flexmb.linearize(model, frame="ground").state_space(["motor"], [])
    assert ground.states == ("bead.r.x", "bead.r.x'", "motor", "motor'")
    x, xd, u, ud, udd = np.eye(5)
    dr = (x + r * s * u) / c
    drd = (xd + w * s * dr + r * w * c * u + r * s * ud) / c
    drdd = (w * w - k / m) * dr + 2 * r * w * ud
    xdd = c * (drdd - w * w * dr - 2 * r * w * ud) - s * (2 * w * drd - r * w * w * u + r * udd)
    np.testing.assert_allclose(np.append(ground.A[1], ground.B[1]), xdd, rtol=1e-6, atol=1e-6)


def test_what_acts_between_two_bodies_moves_both():
    """A spring's force parts two masses; a force at a point of one acts back at that point."""
    masses, J, arm = (2.0, 5.0), 0.7, np.array([0.3, 0.4])
    model = Model("two", plane="xy")
    for name, mass, x in zip("ab", masses, (0.0, 1.0), strict=True):
        model.add_body(name, mass=mass, inertia=[1, 1, J], position=[x, 0, 0])
        model.add_sensor(name, "acceleration", of=name)
        model.add_sensor(f"turn_{name}", "angular_acceleration", of=name)
    model.add_marker("a.edge", position=[1 - arm[0], -arm[1], 0])
    model.add_force("link", "spring-damper", between=["a", "b"], stiffness=10.0)
    model.add_force("push", "force", at="a.edge", reaction="b", value=[0, 0, 0])
    space = flexmb.linearize(model).state_space()
    D = {pair: space.D[space.outputs.index(pair[0]), space.inputs.index(pair[1])]
         for pair in (("a.x", "link"), ("b.x", "link"), ("b.x", "push.x"), ("turn_b.z", "push.x"),
                      ("turn_b.z", "push.y"), ("turn_a.z", "push.y"))}  # fmt: skip
    wanted = (-1 / masses[0], 1 / masses[1], -1 / masses[1], -arm[1] / J, arm[0] / J,
              (1 - arm[0]) / J)  # fmt: skip
    np.testing.assert_allclose(list(D.values()), wanted, rtol=1e-9)


def test_static_responses_are_limits():
    """A cart that a force pulls ever faster holds its pendulum at the angle −a/g; the cart itself
    has no limit. Beside it a slider on a spring k, and one in a damper, which creeps without end
    and shows only with a factor of 1e-6."""
    k = 80.0
    model = Model("cart", gravity=[0, -G, 0])
    for name, mass in (("cart", 1.0), ("sprung", 3.0), ("creeping", 4.0)):
        model.add_body(name, mass=mass, inertia=[1, 1, 1])
        model.add_joint(f"{name}_rail", "prismatic", between=["ground", name], axis="x")
        model.add_sensor(name, "position", of=name)
    model.add_body("bar", mass=2.0, center=[0, -0.5, 0], inertia=[0.2, 0.2, 0.3])
    model.add_joint("pin", "revolute", between=["cart", "bar"], axis="z")
    model.add_sensor("turn", "angle", joint="pin")
    model.add_sensor("speed", "velocity", of="sprung")
    model.add_sensor("rate", "acceleration", of="cart")
    model.add_force("spring", "bushing", between=["ground", "sprung"], stiffness=[k, 0, 0])
    model.add_force("oil", "bushing", between=["ground", "creeping"], damping=[5.0, 0, 0],
                    stiffness=[0, 0, 0])  # fmt: skip
    for name in ("cart", "sprung", "creeping"):
        model.add_force(f"push_{name}", "force", at=name, value=[0, 0, 0])
    model.add_sensor("mixed", "expression", value="sprung.x + 1e-6*creeping.x", unit="m")
    made = flexmb.linearize(model)
    for force, channel, wanted in (
        ("push_cart.x", "turn", -1 / (3.0 * G)),
        ("push_cart.x", "rate.x", 1 / 3.0),
        ("push_cart.x", "cart.x", np.nan),
        ("push_sprung.x", "sprung.x", 1 / k),
        ("push_sprung.x", "speed.x", 0.0),
        ("push_creeping.x", "creeping.x", np.nan),
        ("push_sprung.x", "mixed", 1 / k),
        ("push_creeping.x", "mixed", np.nan),
    ):
        found = made.frequency_response(force, channel, [0.0, 1.0])
        np.testing.assert_allclose(found[0], wanted, rtol=1e-9, atol=1e-15, err_msg=channel)
        assert np.isfinite(found[1])


def test_static_responses_beside_controllers_and_to_drivers():
    """A disk that a gain holds turns by 1/gain, with or without a state that adds up its speed;
    with an integral term it returns to zero, and the controller gives the whole moment back. A
    slider on a rod follows its crank by the derivative of their equation."""
    gain, r, l, phi = 8.0, 0.2, 0.5, 0.7  # noqa: E741
    for ki, turn, torque in ((0.0, 1 / gain, -1.0), (3.0, 0.0, -1.0)):
        model = Model("servo")
        model.add_body("disk", mass=3.0, inertia=[0.01, 0.01, 0.02])
        model.add_joint("shaft", "revolute", between=["ground", "disk"], axis="z")
        model.add_sensor("angle", "angle", joint="shaft")
        model.add_sensor("speed", "angle", joint="shaft", derivative=1)
        model.add_controller("hold", "pid", input="0 - angle", kp=gain, ki=ki, unit="N m")
        model.add_state("turned", rate="speed", unit="rad")
        model.add_force("motor", "rotational-spring-damper", joint="shaft",
                        value="hold - 0.4*speed")  # fmt: skip
        model.add_sensor("moment", "expression", value="hold", unit="N m")
        made = flexmb.linearize(model)
        for channel, wanted in (("angle", turn), ("turned", turn), ("moment", torque)):
            (found,) = made.frequency_response("motor", channel, [0.0])
            assert found == pytest.approx(wanted, rel=1e-9, abs=1e-12), (ki, channel)
    far = r * np.cos(phi) + np.sqrt(l**2 - (r * np.sin(phi)) ** 2)
    model = Model("crank", plane="xy")
    turned = {"orientation": {"axis": "z", "angle": f"{phi} rad"}}
    model.add_body("crank", mass=1.0, inertia=[1, 1, 1], **turned)
    model.add_marker("crank.pin", position=[r, 0, 0])
    model.add_body("slider", mass=1.0, inertia=[1, 1, 1], position=[far, 0, 0])
    model.add_joint("axle", "revolute", between=["ground", "crank"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    model.add_joint("rod", "distance", between=["crank.pin", "slider"], length=l)
    model.add_driver("motor", joint="axle", angle="0*t")
    model.add_sensor("slider", "position", of="slider")
    (found,) = flexmb.linearize(model).frequency_response("motor", "slider.x", [0.0])
    slope = -r * np.sin(phi) * (1 + r * np.cos(phi) / (far - r * np.cos(phi)))
    assert found == pytest.approx(slope, rel=1e-9)
