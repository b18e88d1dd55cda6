"""A planar scene is the spatial one with rows and columns left out."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line
from truthkit import run

from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError, SceneError
from flexmb.fe import rectangle, reduce
from flexmb.model import Model
from flexmb.model.joints.joint import count

STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}
# turns x, y, z into the axes of each plane: in it twice, and its normal
TURNS = {plane: np.roll(np.eye(3), k, axis=0) for k, plane in enumerate(("xy", "yz", "zx"))}


class Scene:
    """Vectors given in the plane xy, turned into another plane."""

    def __init__(self, plane, planar):
        self.turn = TURNS[plane]
        self.made = Model("planar", gravity=self(0.5, -9.81, 0), plane=plane if planar else None)

    def __call__(self, *vector):
        return (self.turn @ np.array(vector, dtype=float)).tolist()

    def body(self, name, at, end, center, **more):
        """A body whose own axes are the global ones."""
        self.made.add_body(
            name, mass=1.5, center=self(*center), inertia=[0.04, 0.05, 0.06],
            position=self(*at), markers={"end": {"position": self(*end)}}, **more,
        )  # fmt: skip

    def joint(self, name, kind, I, J, axis=None):  # noqa: E741
        more = {} if axis is None else {"axis": self(*axis)}
        self.made.add_joint(name, kind, between=[I, J], **more)


def mechanism(plane, planar):
    """A loop with a slider on a tilted guide, a welded arm, springs, loads."""
    scene = Scene(plane, planar)
    scene.body("crank", (0, 0, 0), (0.3, 0.2, 0), (0.1, 0.1, 0))
    scene.body("rod", (0.3, 0.2, 0), (0.9, -0.1, 0), (0.5, 0.02, 0))
    scene.body("slider", (1.2, 0.1, 0), (0.1, 0, 0), (0, 0, 0))
    scene.body("arm", (0.3, 0.2, 0), (0, 0.5, 0), (0, 0.2, 0))
    scene.joint("bearing", "revolute", "ground", "crank", (0, 0, 1))
    scene.joint("pin", "spherical", "crank.end", "rod")
    scene.joint("wrist", "revolute", "rod.end", "slider", (0, 0, -1))
    scene.joint("guide", "prismatic", "ground", "slider", (1, 0.3, 0))
    scene.joint("weld", "fixed", "crank.end", "arm")
    made = scene.made
    made.add_force("spring", "spring-damper", between=["ground", "arm.end"], stiffness=300,
                   damping=2, free_length=0.5)  # fmt: skip
    made.add_force("coil", "rotational-spring-damper", joint="bearing", stiffness=5, damping=0.1)
    made.add_force("push", "force", at="slider", value=[f"{c!r}*cos(9*t)" if c else 0
                                                        for c in scene(4.0, 1.0, 0)])  # fmt: skip
    made.set_assembly()  # the slider is brought onto its guide
    made.add_sensor("arm", "position", of="arm.end")
    made.add_sensor("angle", "angle", joint="wrist")
    return made


@pytest.mark.parametrize("plane", TURNS)
def test_planar_and_spatial_move_alike(plane):
    """A spatial row of the loop is redundant: reactions out of the plane are not unique."""
    knobs = {"duration": 0.2, "step": 1e-3, "outputs": 20, "newton_tolerance": 1e-12}
    flat, deep = (run(mechanism(plane, planar), **knobs) for planar in (True, False))
    for name in ("q", "v", "vd", "sensors"):
        one, other = getattr(flat, name), getattr(deep, name)
        size = np.abs(other).max()
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * size, err_msg=name)
    assert np.ptp(deep.sensors, axis=0).max() > 0.1


def swing(planar, away, size):
    """Three bars on pins that fall from rest; `size` scales all lengths and the gravity."""
    made = Model("swing", gravity=[0, -9.81 * size, 0], plane="xy" if planar else None)
    made.add_marker("ground.post", position=[away, away, 0])
    before = "ground.post"
    for k in range(3):
        place = [away + size * k, away, 0]
        made.add_body(f"b{k}", mass=1.0, center=[0.4 * size, 0.1 * size, 0],
                      inertia=[0.1 * size**2] * 3, position=place,
                      markers={"end": {"position": [size, 0, 0]}})  # fmt: skip
        made.add_joint(f"j{k}", "revolute", between=[before, f"b{k}"], axis="z")
        before = f"b{k}.end"
    made.add_sensor("end", "position", of=before)
    return made


# Explicit steps differ by round-off. With fixed steps Newton's method leaves 1e-8 of v̇, which the
# swing makes some ten times larger; a kilometre away positions round off at 1e-13 m, not 1e-16.
@pytest.mark.parametrize(
    ("method", "away", "size", "off"),
    [
        ("explicit-rk", 0.0, 1.0, 1e-12),
        ("explicit-rk", 0.0, 1e-6, 1e-12),
        ("generalized-alpha", 0.0, 1.0, 1e-7),
        ("generalized-alpha", 0.0, 1e-6, 1e-7),
        ("generalized-alpha", 1000.0, 1.0, 1e-6),
    ],
)
def test_bars_from_rest_swing_alike(method, away, size, off):
    """In µm, and a kilometre away, the planar scene moves as the spatial one."""
    knobs = {"duration": 1.0, "step": 1e-3, "outputs": 20, "method": method}
    flat, deep = (run(swing(planar, away, size), **knobs).sensors for planar in (True, False))
    np.testing.assert_allclose(flat, deep, rtol=0, atol=off * size)
    assert np.ptp(deep, axis=0).max() > size


def test_reactions_in_the_plane_are_the_same():
    knobs = {"duration": 0.2, "step": 1e-3, "outputs": 10, "newton_tolerance": 1e-12}
    flat, deep = (run(mechanism("xy", planar), **knobs) for planar in (True, False))
    for joint in ("joints.pin", "joints.bearing", "drivers", "forces.coil"):
        if joint not in flat.layout.reactions:
            continue
        at = 12 * flat.layout.reactions.index(joint)
        in_plane = [at, at + 1, at + 5]
        size = np.abs(deep.reactions[:, in_plane]).max()
        np.testing.assert_allclose(
            flat.reactions[:, in_plane], deep.reactions[:, in_plane], rtol=0, atol=1e-7 * size
        )


@pytest.mark.parametrize("plane", TURNS)
def test_counts_are_three_for_each_body_less_the_rows(plane):
    made = mechanism(plane, True)
    counted = count(made)
    rows = 2 + 2 + 2 + 2 + 3  # revolute, spherical, revolute, prismatic, fixed
    assert (counted.rigid_coordinates, counted.equations) == (12, rows)
    assert counted.mobility == 12 - rows == 1
    compiled = compile_system(made)
    scalars = len(compiled.layout.coordinates)
    assert (compiled.system.kkt.column >= 0).sum() == 12 + scalars
    assert compiled.layout.nc == rows + scalars
    # fewer unknowns, not more zeros
    assert len(compiled.system.kkt.panels) == 4 + scalars + len(compiled.system.groups)
    assert compiled.system.kkt.panels["nc"].sum() == 12 + rows + 2 * scalars


def test_a_weld_has_no_second_branch():
    """Turned by nearly 180°, where products of axes vanish as well, a planar weld finds its way."""
    made = Model("weld", plane="xy")
    made.add_body("a", mass=1, inertia=[1, 1, 1],
                  orientation={"axis": "z", "angle": "179 deg"})  # fmt: skip
    made.add_joint("weld", "fixed", between=["ground", "a"])
    made.add_sensor("a", "angle", between=["ground", "a"])
    made.set_assembly()
    found = run(made, duration=0.01, step=0.01, outputs=1)
    assert abs(found["a"][0]) < 1e-9
    made.plane = None
    with pytest.raises(AssemblyError):
        run(made, duration=0.01, step=0.01, outputs=1)


def rod(plane=None):
    return reduce(
        line(8, end=(0.45, 0, 0)), material=STEEL, interfaces={"root": "root", "tip": "tip"},
        modes=4 if plane is None else 2, sections={"all": rectangle(0.012, 0.02)}, plane=plane,
    )  # fmt: skip


def flexible(body, plane):
    made = Model("crank", plane=plane)
    made.add_body("crank", mass=1.0, inertia=[0.01] * 3)
    made.add_marker("crank.pin", position=[0.15, 0, 0])
    made.add_body("rod", body, position=[0.15, 0, 0])
    made.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[0.6, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod.root"])
    made.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle="100*t")
    made.add_sensor("slider", "acceleration", of="slider")
    made.add_sensor("span", "position", of="rod.tip", relative_to="rod.root")
    return made


def test_a_flexible_body_keeps_its_modes_in_the_plane():
    """Symmetric rod: in-plane modes alone move as all modes do (its others are not excited)."""
    knobs = {"duration": 0.03, "step": 5e-5, "outputs": 30, "newton_tolerance": 1e-10}
    deep = run(flexible(rod(), None), **knobs)
    assert rod("xy").m == 2 * 3 + 2 - 3 and rod().m == 10
    for body in (rod("xy"), rod()):  # reduced so, or selected by the planar scene itself
        flat = run(flexible(body, "xy"), **knobs)
        assert flat.layout.bodies[1].m < 10
        size = np.abs(deep.sensors).max(axis=0) + 1e-3
        np.testing.assert_allclose(flat.sensors / size, deep.sensors / size, rtol=0, atol=2e-6)


OUT_OF_PLANE = [
    (lambda m: m.set_gravity([0, 0, -9.81]), "gravity: has a component normal to the plane xy"),
    (lambda m: m.add_joint("j", "revolute", between=["ground", "b"], axis="x"),
     "joints.j.axis: must be normal to the plane xy"),
    (lambda m: m.add_joint("j", "prismatic", between=["ground", "b"], axis="z"),
     "joints.j.axis: must lie in the plane xy"),
    (lambda m: m.add_force("f", "force", at="b", value=[0, 0, "t"]),
     "forces.f.value[2]: has a component normal to the plane xy"),
    (lambda m: m.add_force("f", "torque", at="b", value=["t", 0, 1]),
     "forces.f.value[0]: has a component parallel to the plane xy"),
    (lambda m: m.add_body("c", mass=1, inertia=[1, 1, 1], velocity=[0, 0, 1]),
     "bodies.c.velocity: has a component normal to the plane xy"),
    (lambda m: m.add_body("c", mass=1, inertia=[1, 1, 1], angular_velocity=[1, 0, 0]),
     "bodies.c.angular_velocity: is not about the normal of xy"),
    (lambda m: m.add_body("c", mass=1, inertia=[1, 1, 1],
                          orientation={"axis": "x", "angle": "10 deg"}),
     "bodies.c.orientation: no axis of the body is normal to the plane xy"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "sentence"), OUT_OF_PLANE)
def test_what_leads_out_of_the_plane_is_refused(change, sentence):
    made = Model("flat", plane="xy")
    made.add_body("b", mass=1, inertia=[1, 1, 1])
    change(made)
    with pytest.raises(SceneError) as caught:
        made.validate()
    assert str(caught.value).startswith(sentence)


def test_an_unknown_plane_names_those_there_are():
    with pytest.raises(SceneError, match='plane: unknown plane "xz"; allowed: xy, yz, zx'):
        Model(plane="xz")
