"""Joints on curves against closed forms: cams, slots, beads.

Shapes are given by expressions, so the curves themselves are exact to round-off (1e-13 of their
size); positions under drivers are as exact as Newton's method leaves them.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes.judging import judged
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from truthkit import order, run

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.engine.compile import compile_system
from flexmb.model import Model

G = 9.81
SPEED = 10.0  # rad/s
R, E = 0.05, 0.02  # m: disk cam and its eccentricity
CLOSED = 1e-11  # m, on lengths of 0.1 m


def cam(kind, driven=True, shape=None, gravity=(0, 0, 0), height=R + 0.01, **fields):
    """A cam on a pivot and a follower that slides along y above it, its foot the joint's J."""
    made = Model(kind, plane="xy", gravity=list(gravity))
    made.set_assembly()  # the follower is brought to the cam
    made.add_curve("profile", **(shape or {"circle": R, "center": [E, 0]}))
    made.add_body("cam", mass=1.0, center=[0.01, 0, 0], inertia=[1e-3, 1e-3, 2e-3],
                  angular_velocity=[0, 0, 0 if driven else SPEED])  # fmt: skip
    made.add_body("follower", mass=0.5, inertia=[1e-3] * 3, position=[0, height, 0])
    made.add_joint("pivot", "revolute", between=["ground", "cam"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "follower"], axis="y")
    made.add_joint("contact", kind, between=["cam", "follower"], curve="profile", **fields)
    if driven:
        made.add_driver("motor", joint="pivot", angle=f"{SPEED}*t")
    for sensor in ("position", "velocity", "acceleration"):
        made.add_sensor(sensor, sensor, of="follower")
    return made


def lift(found, sensor="position"):
    return found.vector(sensor)[:, 1]


def test_eccentric_disk_with_a_flat_follower():
    """y = r + e sin θ; the flat carries m (y'' + g), the motor the contact force times its arm."""
    made = cam("cam-flat", axis="y", gravity=(0, -G, 0))
    made.add_sensor("place", "place", joint="contact")
    made.add_sensor("rate", "place", joint="contact", derivative=1)
    for side in "IJ":
        made.add_sensor(f"on_{side}", "reaction", joint="contact", on=side)
    found = run(made, duration=1.3, outputs=26, step=0.01)
    a = SPEED * found.t
    np.testing.assert_allclose(lift(found), R + E * np.sin(a), rtol=0, atol=CLOSED)
    np.testing.assert_allclose(lift(found, "velocity"), E * SPEED * np.cos(a), atol=1e-9)
    rise = -E * SPEED**2 * np.sin(a)
    np.testing.assert_allclose(lift(found, "acceleration"), rise, atol=1e-7)
    # on the follower, in the axes of its marker, whose z is the axis; the force acts at x = e cos θ
    force = 0.5 * (rise + G)
    on_flat, on_cam = found.reactions[:, 24:30], found.reactions[:, 30:36]
    np.testing.assert_allclose(on_flat[:, 2], force, atol=1e-6)
    np.testing.assert_allclose(np.abs(on_flat[:, 3:]).max(axis=1), np.abs(force * E * np.cos(a)),
                               atol=1e-6)  # fmt: skip
    # on the cam at the point of contact: across the curve, nothing along it, no moment
    np.testing.assert_allclose(np.abs(on_cam[:, 1]), np.abs(force), atol=1e-6)
    np.testing.assert_allclose(on_cam[:, [0, 5]], 0.0, atol=1e-7)
    np.testing.assert_allclose(found.vector("on_J"), on_flat[:, :3], atol=1e-9)
    np.testing.assert_allclose(found.vector("on_I"), on_cam[:, :3], atol=1e-9)
    # contact is at the top of the disk, which turns away under it, over two turns
    np.testing.assert_allclose(found["place"], R * (0.5 * np.pi - a), atol=1e-10)
    np.testing.assert_allclose(found["rate"], -R * SPEED, atol=1e-8)
    torque = -found.reaction("drivers.motor")[:, 0]
    weight = 1.0 * G * 0.01 * np.cos(a)
    np.testing.assert_allclose(torque, weight + force * E * np.cos(a), atol=1e-6)


@pytest.mark.parametrize(("kind", "fields"), [
    ("cam-roller", {"radius": 0.01}), ("cam-knife", {}), ("pin-in-slot", {}),
    ("point-on-curve", {}),
])  # fmt: skip
def test_eccentric_disk_with_a_pointed_follower_is_a_slider_crank(kind, fields):
    found = run(cam(kind, **fields), duration=1.3, outputs=26, step=0.01)
    a, rod = SPEED * found.t, R + fields.get("radius", 0.0)
    wanted = E * np.sin(a) + np.sqrt(rod**2 - (E * np.cos(a)) ** 2)
    np.testing.assert_allclose(lift(found), wanted, rtol=0, atol=CLOSED)


def test_a_roller_on_a_disk_moves_freely_like_a_rod():
    """Not driven, under gravity: the cam pair and the rod have the same equations but for s."""
    weight = (2.0, -G, 0)
    closed = {"gravity": weight, "height": np.sqrt((R + 0.01) ** 2 - E**2), "radius": 0.01}
    rolling, rod = (cam("cam-roller", driven=False, **closed) for _ in range(2))
    del rod.joints["contact"]
    rod.add_marker("cam.middle", position=[E, 0, 0])
    rod.add_joint("rod", "distance", between=["cam.middle", "follower"], length=R + 0.01)
    one, two = (run(made, duration=1.0, outputs=20, step=1e-3) for made in (rolling, rod))
    assert np.ptp(lift(two)) > E
    np.testing.assert_allclose(one.q[:, :14], two.q[:, :14], rtol=0, atol=1e-8)
    np.testing.assert_allclose(one.vd[:, :12], two.vd[:, :12], rtol=0, atol=1e-5)
    # λ of the row across is the force in the rod
    across = one.reaction("joints.contact")[:, 1]
    np.testing.assert_allclose(np.abs(across), np.abs(two.reaction("joints.rod")[:, 0]), atol=1e-5)
    # nothing along the curve, but for what a step of 1 ms leaves of accelerations (4e-5)
    np.testing.assert_allclose(one.reaction("joints.contact")[:, 0], 0.0, atol=1e-4)


def test_two_disks_are_a_rod_between_their_middles():
    height = np.sqrt((R + 0.03) ** 2 - E**2)
    made, rod = (cam("cam-knife", driven=False, height=height) for _ in range(2))
    del made.joints["contact"], rod.joints["contact"]
    made.add_curve("disk", circle=0.03)
    made.add_joint("contact", "cam-cam", between=["cam", "follower"], curve="profile",
                   second_curve="disk")  # fmt: skip
    rod.add_marker("cam.middle", position=[E, 0, 0])
    rod.add_joint("rod", "distance", between=["cam.middle", "follower"], length=R + 0.03)
    one, two = (run(m, duration=1.0, outputs=20, step=1e-3) for m in (made, rod))
    np.testing.assert_allclose(one.q[:, :14], two.q[:, :14], rtol=0, atol=1e-8)


RISE, BETA, BASE = 0.015, 2.0, 0.04  # m, rad, m
CYCLOID = f"{RISE}*(t/{BETA} - sin(2*pi*t/{BETA})/(2*pi))"


def cycloidal(a):
    """Cycloidal rise: lift and its two derivatives over the angle."""
    x = a / BETA
    return (
        RISE * (x - np.sin(2 * np.pi * x) / (2 * np.pi)),
        RISE / BETA * (1 - np.cos(2 * np.pi * x)),
        RISE / BETA**2 * 2 * np.pi * np.sin(2 * np.pi * x),
    )


@pytest.mark.parametrize("kind", ["cam-knife", "cam-flat"])
def test_cycloidal_profile(kind):
    """Radius b + h for an edge; for a flat the envelope (b + h) n + h' t (Norton, Cam Design).

    The cam turns backwards from where its profile begins above the pivot.
    """
    h, slope = f"({BASE} + {CYCLOID})", f"({RISE}/{BETA}*(1 - cos(2*pi*t/{BETA})))"
    shape = {"polar": h, "range": [0, BETA]}
    if kind == "cam-flat":
        shape = {"x": f"{h}*cos(t) - {slope}*sin(t)", "y": f"{h}*sin(t) + {slope}*cos(t)",
                 "range": [0, BETA]}  # fmt: skip
    made = cam(kind, shape=shape, **({"axis": "y"} if kind == "cam-flat" else {}))
    del made.drivers["motor"]
    begin = 0.1
    made.bodies["cam"] = made.bodies["cam"].model_copy(
        update={"orientation": (np.cos(np.pi / 4 - begin / 2), 0.0, 0.0,
                                np.sin(np.pi / 4 - begin / 2))})  # fmt: skip
    made.add_driver("motor", joint="pivot", angle=f"-{SPEED}*t")
    found = run(made, duration=0.18, outputs=18, step=2e-3)
    value, first, second = cycloidal(begin + SPEED * found.t)
    np.testing.assert_allclose(lift(found), BASE + value, rtol=0, atol=CLOSED)
    np.testing.assert_allclose(lift(found, "velocity"), SPEED * first, atol=1e-8)
    np.testing.assert_allclose(lift(found, "acceleration"), SPEED**2 * second, atol=1e-5)


@pytest.mark.parametrize("table", [False, True])
def test_spiral_of_archimedes_moves_its_pin_evenly(table):
    """A plate with a slot r = c (α + 2π) turns; the pin in it is guided radially: a scroll chuck.

    A table of the polar form holds the same line, which its spline meets exactly.
    """
    pitch = 0.004  # m/rad
    angles = np.linspace(0.0, 12.0, 9)
    shape = {"polar": f"{pitch}*(t + 2*pi)", "range": [0, 12]}
    if table:
        shape = {"polar_points": [[a, pitch * (a + 2 * np.pi)] for a in angles]}
    made = cam("pin-in-slot", shape=shape)
    made.bodies["follower"] = made.bodies["follower"].model_copy(
        update={"position": (0.0, pitch * 2.5 * np.pi, 0.0)})  # fmt: skip
    made.drivers.pop("motor")
    made.add_driver("motor", joint="pivot", angle=f"-{SPEED}*t")
    found = run(made, duration=1.0, outputs=20, step=0.005)
    wanted = pitch * (2.5 * np.pi + SPEED * found.t)
    np.testing.assert_allclose(lift(found), wanted, rtol=0, atol=CLOSED)
    np.testing.assert_allclose(lift(found, "acceleration"), 0.0, atol=1e-6)


def bead(at, curve, plane=None, speed=None, gravity=(0, 0, -G)):
    """A mass point on a curve of the ground."""
    made = Model("bead", gravity=list(gravity), plane=plane)
    made.add_curve("wire", **curve)
    velocity = {} if speed is None else {"velocity": list(speed)}
    made.add_body("bead", mass=0.2, inertia=[1e-4] * 3, position=list(at), **velocity)
    made.add_joint("wire", "point-on-curve", between=["ground", "bead"], curve="wire")
    made.add_sensor("position", "position", of="bead")
    made.add_sensor("acceleration", "acceleration", of="bead")
    return made


def test_bead_on_a_helix():
    """s'' = −g sin α, wherever it is and however fast.

    The wire bears m s'²/ϱ towards the axis, ϱ = r/cos²α, and m g cos α across the slope.
    """
    r, rise = 0.3, 0.4  # m, m/rad
    length = np.hypot(r, rise)
    sin, cos = rise / length, r / length
    curve = {"x": f"{r}*cos(t)", "y": f"{r}*sin(t)", "z": f"{rise}*t", "range": [0, 12]}
    top = 10.0
    at = r * np.cos(top), r * np.sin(top), rise * top
    inward = -np.array([np.cos(top), np.sin(top), 0.0])
    tangent = np.array([-cos * np.sin(top), cos * np.cos(top), sin])
    for speed in (0.0, 2.0, -5.0):
        made = bead(at, curve, speed=speed * tangent)
        first = assemble(compile_system(made), made).state
        assert first.q[-1] == pytest.approx(top * length, abs=1e-9)
        assert first.v[-1] == pytest.approx(speed, abs=1e-9)
        # the pieces' curvature is exact to 1e-9 of it
        assert first.vd[-1] == pytest.approx(-G * sin, abs=1e-6)
        wanted = 0.2 * (speed**2 * cos**2 / r * inward + G * cos * np.cross(tangent, inward))
        np.testing.assert_allclose(-first.lam, wanted, rtol=0, atol=1e-6)
    runs = [run(bead(at, curve), duration=1.0, outputs=10, step=h) for h in (0.01, 0.005)]
    wanted = top * length - 0.5 * G * sin * runs[0].t ** 2
    errors = [np.abs(found.q[:, -1] - wanted).max() for found in runs]
    assert errors[1] < 2e-3 and 1.9 < order([2.0, 1.0], errors) < 2.1
    t = runs[0].q[:, -1] / length
    helix = np.stack([r * np.cos(t), r * np.sin(t), rise * t], axis=1)
    np.testing.assert_allclose(runs[0].vector("position"), helix, rtol=0, atol=1e-9)


CYCLOID_SIZE = 0.1  # m


def swing(share, h):
    """A bead let go on an inverted cycloid, at a share of its half length from the bottom."""
    a = CYCLOID_SIZE
    curve = {"x": f"{a}*(t - sin(t))", "y": f"-{a}*(1 - cos(t))", "range": [0.2, "2*pi - 0.2"]}
    t = 2 * np.arccos(share)  # the length from the bottom is 4 a cos(t/2)
    at = a * (t - np.sin(t)), -a * (1 - np.cos(t)), 0.0
    made = bead(at, curve, plane="xy", gravity=(0, -G, 0))
    period = 4 * np.pi * np.sqrt(a / G)
    found = run(made, duration=2 * period, outputs=40, step=h)
    middle = 4 * a * np.cos(0.1)
    return found, middle - found.q[:, -1], 4 * a * share * np.cos(2 * np.pi * found.t / period)


def test_bead_on_a_cycloid_is_isochronous():
    """Huygens: the length from the bottom swings as 4 a k cos ωt, ω² = g/(4a), at any amplitude."""
    steps = (4e-3, 2e-3, 1e-3)
    for share in (0.9, 0.3):
        errors = []
        for h in steps:
            _, found, wanted = swing(share, h)
            errors.append(np.abs(found - wanted).max())
        assert errors[-1] < 1e-3 * share
        assert 1.9 < order(steps, errors) < 2.1


def test_beads_reach_the_bottom_of_a_cycloid_together():
    """Tautochrone: after a quarter of the period, from anywhere."""
    for share in (0.9, 0.5, 0.2):
        found, place, _ = swing(share, 1e-3)
        quarter = 5
        assert found.t[quarter] == pytest.approx(np.pi * np.sqrt(CYCLOID_SIZE / G))
        assert abs(place[quarter]) < 1e-3 * share * 4 * CYCLOID_SIZE


def test_energy_of_a_free_cam_and_its_follower():
    shape = {"polar": "0.05 + 0.01*cos(t) + 0.003*cos(2*t)", "closed": True}
    moved = []
    for h in (2e-3, 1e-3):
        made = cam("cam-roller", False, shape, (0, -G, 0), radius=0.005)
        found = run(made, duration=0.8, outputs=20, step=h)
        moved.append(found.mismatch())
    assert np.ptp(found.energy[:, 0]) > 0.02
    assert moved[1] < 1e-4 * found.energy[0, 0] and moved[0] > 3 * moved[1]


@pytest.mark.parametrize("mirrored", [False, True], ids=["", "mirrored"])
@pytest.mark.parametrize("plane", ["xy", "yz", "zx", None])
def test_a_cam_in_any_plane_and_in_space(plane, mirrored):
    """The marker that carries the curve tells its plane; its z may look either way."""
    turn = np.roll(np.eye(3), ("xy", "yz", "zx").index(plane) if plane else 1, axis=0)
    face = turn @ np.diag([1.0, -1.0, -1.0]) if mirrored else turn
    made = Model("cam", plane=plane)
    made.add_curve("oval", x="0.05*cos(t)", y="0.03*sin(t)", closed=True)
    made.add_body("cam", mass=1.0, inertia=[1e-3] * 3)
    made.add_marker("cam.face", orientation=face.tolist())
    made.add_body("follower", mass=0.5, inertia=[1e-3] * 3, position=(turn @ [0, 0.03, 0]).tolist())
    pivot, up = turn[:, 2].tolist(), turn[:, 1].tolist()
    made.add_joint("pivot", "revolute", between=["ground", "cam"], axis=pivot)
    made.add_joint("guide", "prismatic", between=["ground", "follower"], axis=up)
    made.add_joint("contact", "cam-flat", between=["cam.face", "follower"], curve="oval", axis=up)
    made.add_driver("motor", joint="pivot", angle=f"{SPEED}*t")
    made.add_sensor("position", "position", of="follower")
    found = run(made, duration=0.7, outputs=14, step=0.01)
    a = SPEED * found.t
    # the height of an ellipse over the angle of a tangent
    wanted = np.hypot(0.05 * np.sin(a), 0.03 * np.cos(a))
    np.testing.assert_allclose(found.vector("position") @ turn[:, 1], wanted, rtol=0, atol=CLOSED)


@pytest.mark.parametrize(
    ("kind", "off", "fields"),
    [
        ("point-on-curve", 0.0, {}),
        ("cam-roller", 0.013, {"radius": 0.013}),
        ("cam-flat", None, {"axis": "y"}),
        ("cam-cam", 0.013, {"second_curve": "second"}),
    ],
)
def test_what_stands_on_its_curve_is_not_moved(kind, off, fields):
    """Placed exactly, between the places along the curve that are tried."""
    place = [-0.01, R, 0] if off is None else [(R + off) * np.cos(0.7), (R + off) * np.sin(0.7), 0]
    made = Model(kind, plane="xy")
    made.add_curve("profile", circle=R)
    made.add_curve("second", circle=0.013)
    made.add_body("cam", mass=1.0, inertia=[1e-3] * 3)
    made.add_body("follower", mass=0.5, inertia=[1e-3] * 3, position=place)
    made.add_joint("contact", kind, between=["cam", "follower"], curve="profile", **fields)
    q = assemble(compile_system(made), made).state.q
    np.testing.assert_allclose(q[[0, 1, 7, 8]], [0, 0, *place[:2]], atol=1e-14)


def test_steps_do_not_stop_where_pieces_of_a_curve_meet():
    """An eccentric disk lifts its flat by e sin: at 1e-8 by long steps of order 8."""
    made = cam("cam-flat", False, axis="y")
    made.add_sensor("turn", "angle", joint="pivot")
    found = run(made, duration=2.0, outputs=40, accuracy=1e-8, method="explicit-rk")
    assert found.statistics["steps"] < 150
    np.testing.assert_allclose(lift(found), R + E * np.sin(found["turn"]), rtol=0, atol=CLOSED)


@pytest.mark.seconds
@pytest.mark.parametrize("accuracy", [1e-7, 1e-8, 1e-9])
def test_a_bead_on_a_wire_in_space_is_as_accurate_as_requested(accuracy):
    """Down six turns of a bent helix: |r'|² u'' = −g z' − r'·r'' u'², beside SciPy."""
    curve = {"x": "0.5*cos(t)", "y": "0.5*sin(t)", "z": "0.05*cos(2*t) - 0.2*t", "range": [-1, 40]}

    def place(u):
        return np.array([0.5 * np.cos(u), 0.5 * np.sin(u), 0.05 * np.cos(2 * u) - 0.2 * u])

    def slope(_, y):
        u, w = y
        first = np.array([-0.5 * np.sin(u), 0.5 * np.cos(u), -0.1 * np.sin(2 * u) - 0.2])
        second = np.array([-0.5 * np.cos(u), -0.5 * np.sin(u), -0.2 * np.cos(2 * u)])
        return [w, -(G * first[2] + first @ second * w * w) / (first @ first)]

    def truth(t):
        ends = {"t_eval": t, "rtol": 3e-14, "atol": 1e-15}
        u = solve_ivp(slope, (0.0, t[-1]), [0.5, 0.0], "DOP853", **ends).y[0]
        return dict(zip(("position.x", "position.y", "position.z"), place(u), strict=True))

    found = judged(bead(place(0.5), curve), truth, duration=2.0, outputs=50, accuracy=accuracy)
    assert found.achieved < 0.5 * accuracy
    assert found.told > found.achieved / 3


EDGES = np.array([2.0, 3.0, 5.0, 6.0])  # rad, where the cam rises and falls
ANGLES = np.linspace(0.0, 2 * np.pi, 13)
RADII = 0.05 + 0.006 * np.cos(ANGLES) + 0.002 * np.cos(2 * ANGLES) + 5e-4 * np.cos(5 * ANGLES)
TABLE = CubicSpline(ANGLES, np.append(RADII[:-1], RADII[0]), bc_type="periodic")


def risen(angle):
    """Radius and slope of a cam that dwells, from the words of `step5`."""
    a = angle % (2 * np.pi)
    up, down = np.clip(a - EDGES[0], 0, 1), np.clip(a - EDGES[2], 0, 1)
    radius = 0.05 + 0.01 * sum(
        k * u**3 * (10 - 15 * u + 6 * u * u) for k, u in ((1, up), (-1, down))
    )
    return radius, 0.3 * ((up * (1 - up)) ** 2 - (down * (1 - down)) ** 2)


def turned(t, profile, edges, speed):
    """Angle of a free cam under a sprung knife: t = ∫ dφ √(D / 2 (E − V)) from edge to edge."""
    x, w = np.polynomial.legendre.leggauss(30)

    def rate(a):
        radius, slope = profile(np.pi / 2 - a)
        potential = 0.6 * G * radius + 1500 * (radius - 0.03) ** 2
        return potential, 2e-3 + 0.6 * slope**2

    def lasts(low, high):
        potential, inertia = rate(0.5 * (low + high) + 0.5 * (high - low) * x)
        return 0.5 * (high - low) * np.sum(w * np.sqrt(inertia / 2 / (energy - potential)))

    begin = rate(0.0)
    energy = begin[0] + 0.5 * begin[1] * speed**2
    turns = 2 * np.pi * np.arange(np.ceil(speed * t[-1] / 6) + 2)[:, None]
    nodes = np.sort(np.append((np.pi / 2 - edges + turns).ravel(), 0.0))
    nodes = np.unique(
        np.concatenate([nodes + k * np.diff(nodes, append=nodes[-1]) / 8 for k in range(8)])
    )
    nodes = nodes[nodes >= 0.0]
    times = np.append(
        0.0, np.cumsum([lasts(*pair) for pair in zip(nodes[:-1], nodes[1:], strict=True)])
    )
    found = np.interp(t, times, nodes)
    for k, moment in enumerate(t):
        i = np.searchsorted(times, moment, side="right") - 1
        for _ in range(6):  # Newton's method
            potential, inertia = rate(found[k])
            ahead = times[i] + lasts(nodes[i], found[k]) - moment
            found[k] -= ahead * np.sqrt(2 * (energy - potential) / inertia)
    return found


@pytest.mark.parametrize(
    ("shape", "profile", "edges", "speed"),
    [
        (
            {"polar": "0.05 + 0.01*(step5(t, 2, 0, 3, 1) - step5(t, 5, 0, 6, 1))"},
            risen,
            EDGES,
            60.0,
        ),
        (
            {"polar_points": np.column_stack([ANGLES, TABLE(ANGLES)]).tolist()},
            lambda a: (TABLE(a), TABLE(a, 1)),
            ANGLES[:-1],
            40.0,
        ),
    ],
    ids=["rises", "table"],
)
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_steps_end_where_the_slope_of_the_curvature_jumps(shape, profile, edges, speed, accuracy):
    """Of a free cam: 5.2e-3 of the lift of the table at 1e-3 by radau, 5.7e-4 told; rises 0.29."""
    made = Model("cam", plane="xy", gravity=[0, -G, 0])
    made.add_curve("profile", closed=True, **shape)
    made.add_body("cam", mass=2.0, inertia=[2e-3] * 3, angular_velocity=[0, 0, speed])
    made.add_body(
        "follower", mass=0.6, inertia=[1e-3] * 3, position=[0, float(profile(np.pi / 2)[0]), 0]
    )
    made.add_joint("pivot", "revolute", between=["ground", "cam"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "follower"], axis="y")
    made.add_joint("contact", "cam-knife", between=["cam", "follower"], curve="profile")
    made.add_force(
        "spring", "translational-spring-damper", joint="guide", stiffness=3000, free=0.03
    )
    made.add_sensor("turn", "angle", joint="pivot")
    made.add_sensor("lift", "position", of="follower")

    def truth(t):
        angle = turned(t, profile, edges, speed)
        return {"turn": angle, "lift.y": profile(np.pi / 2 - angle)[0]}

    made = judged(made, truth, duration=1.0, outputs=50, accuracy=accuracy, method="radau")
    assert made.is_reached(accuracy)
    assert made.achieved / 3 < made.told < 3.5 * made.achieved
