"""Reactions of statically determinate frames by hand, in space and in the plane.

A reaction is a wrench on marker J in the axes of marker J and one on marker I in the axes of
marker I; here both are turned back into global axes, with the marker axes that the scene was given.
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line
from flexiblescenes import rod
from scipy.spatial.transform import Rotation
from truthkit import run

from flexmb.fe import rectangle, reduce
from flexmb.model import Model

G = 9.81
STIFFENED = {"geometric_stiffening": "full"}


class Frame:
    """A scene whose bodies stand and whose markers are given in global places and axes."""

    def __init__(self, plane=None):
        self.made = Model("frame", gravity=[0, -G, 0], plane=plane)
        self.pose = {"ground": (np.zeros(3), np.eye(3))}
        self.axes = {}  # global, of every marker
        self.place = {}
        self.loads = {}  # of every body: wrenches about the global origin

    def body(self, name, at, turn, mass, center):
        """A body with its centre at a global point; its weight is its first load."""
        r, A = np.array(at, float), Rotation.from_rotvec(turn).as_matrix()
        self.pose[name] = r, A
        self.made.add_body(
            name, mass=mass, center=list(A.T @ (center - r)), inertia=[0.2, 0.2, 0.2],
            position=list(r), orientation=A.tolist(),
        )  # fmt: skip
        self.loads[name] = [wrench([0, -mass * G, 0], at=center)]

    def marker(self, body, name, x, turn=(0, 0, 0)):
        r, A = self.pose[body]
        R = Rotation.from_rotvec(turn).as_matrix()
        where = {"position": list(A.T @ (x - r)), "orientation": (A.T @ R).tolist()}
        self.made.add_marker(f"{body}.{name}", **where)
        self.axes[f"{body}.{name}"], self.place[f"{body}.{name}"] = R, np.array(x, float)
        return f"{body}.{name}"

    def load(self, body, kind, value, x=(0, 0, 0), turn=None):
        """A force or torque; with `turn`, its components are in the turned axes of its marker."""
        name = f"load{len(self.made.forces)}"
        at = self.marker(body, name, x, (0, 0, 0) if turn is None else turn)
        axes = "global" if turn is None else "body"
        self.made.add_force(name, kind, at=at, value=list(value), axes=axes)
        value = self.axes[at] @ value
        force, moment = (value, np.zeros(3)) if kind == "force" else (np.zeros(3), value)
        self.loads[body].append(wrench(force, moment, x))

    def on(self, *bodies):
        """Wrench of all loads on these bodies about the global origin."""
        return sum(load for body in bodies for load in self.loads[body])

    def solve(self):
        return run(self.made, duration=0.01, step=0.005, outputs=1, newton_tolerance=1e-12)


def wrench(force, moment=(0, 0, 0), at=(0, 0, 0)):
    """Force and moment about the global origin, of a force at a point."""
    return np.hstack([force, np.cross(at, force) + moment])


def reported(frame, result, path, I, J, row=-1):  # noqa: E741
    """Wrenches on the bodies of J and of I about the global origin, from the table."""
    at = 12 * result.layout.reactions.index(path)
    part = result.reactions[row, at : at + 12].reshape(4, 3)
    on_J, on_I = frame.axes[J], frame.axes[I]
    return (
        wrench(on_J @ part[0], on_J @ part[1], frame.place[J]),
        wrench(on_I @ part[2], on_I @ part[3], frame.place[I]),
    )


def compare(found, wanted, size):
    """Acting on J as wanted, on I the opposite."""
    on_J, on_I = found
    np.testing.assert_allclose(on_J, wanted, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(on_I, np.negative(wanted), rtol=0, atol=1e-9 * size)


# --- a three-hinged arch: springings A and B, crown C ---

A, B, C = np.array([0, 0, 0.0]), np.array([5, 1, 0.0]), np.array([2, 3, 0.0])


def arch(plane, across=0.0):
    """The arch with weights, two forces and a torque; `across`: as much out of its plane."""
    frame = Frame(plane)
    frame.body("left", A, [0, 0, 0.35], 3.0, np.array([0.9, 1.8, 0]))
    frame.body("right", B, [0, 0, 1.9], 4.0, np.array([3.7, 2.3, 0]))
    z = lambda angle: [0, 0, angle]  # noqa: E731
    ends = {
        "A": ("spherical", frame.marker("ground", "A", A, z(0.3)),
              frame.marker("left", "A", A, z(0.8))),
        "C": ("revolute", frame.marker("left", "C", C, z(-0.4)),
              frame.marker("right", "C", C, z(2.0))),
        "B": ("cylindrical", frame.marker("right", "B", B, z(1.1)),
              frame.marker("ground", "B", B, z(-0.7))),
    }  # fmt: skip
    for name, (kind, I, J) in ends.items():  # noqa: E741
        frame.made.add_joint(name, kind, between=[I, J])
    frame.load("left", "force", [3, -80, 20 * across], [0.8, 1.7, 0])
    frame.load("right", "force", [-60, 10, -30 * across], [3.6, 2.4, 0], None if across else z(0.6))
    frame.load("right", "torque", [15 * across, -5 * across, 40])
    return frame, {name: pair for name, (_, *pair) in ends.items()}


@pytest.mark.parametrize("plane", ["xy", None])
def test_three_hinged_arch(plane):
    """Moments about A of the left half and about B of the right one give the crown's force."""
    frame, ends = arch(plane)
    result = frame.solve()
    left, right = frame.on("left"), frame.on("right")
    about_A = left[5]
    about_B = right[5] - (B[0] * right[1] - B[1] * right[0])
    # The force c of the left half on the right one, at C.
    arm, other = C - A, C - B
    lever = np.array([[-arm[1], arm[0]], [-other[1], other[0]]])
    c = np.append(np.linalg.solve(lever, [about_A, -about_B]), 0.0)
    forces = {"A": c - left[:3], "C": c, "B": c + right[:3]}
    size = np.abs(c).max()
    for name, (place, force) in zip(
        "ACB", ((A, forces["A"]), (C, c), (B, forces["B"])), strict=True
    ):
        found = reported(frame, result, f"joints.{name}", *ends[name])
        compare(found, wrench(force, at=place), size)
        at = 12 * result.layout.reactions.index(f"joints.{name}")
        moments = result.reactions[-1, at : at + 12].reshape(4, 3)[[1, 3]]
        np.testing.assert_allclose(moments, 0, atol=1e-9 * size)  # they are hinges


def test_arch_loaded_across_its_plane():
    """Twelve equations of equilibrium for twelve reactions: 3 at A, 5 at C, 4 at B."""
    frame, ends = arch(None, across=1.0)
    result = frame.solve()
    unknown = []  # (name, wrench on J, its row of the equations of the right and left half)
    for name, place, axes, moments in (("A", A, 3, 0), ("C", C, 3, 2), ("B", B, 2, 2)):
        unknown += [(name, wrench(e, at=place)) for e in np.eye(3)[:axes]]
        unknown += [(name, wrench(np.zeros(3), e)) for e in np.eye(3)[:moments]]
    signs = {"A": (1, 0), "C": (-1, 1), "B": (0, -1)}  # J of A is left, of C right, of B ground
    columns = [np.outer(signs[name], unit).ravel() for name, unit in unknown]
    amounts = np.linalg.solve(
        np.array(columns).T, -np.hstack([frame.on("left"), frame.on("right")])
    )
    for name in "ACB":
        parts = [
            x * unit for x, (owner, unit) in zip(amounts, unknown, strict=True) if owner == name
        ]
        compare(reported(frame, result, f"joints.{name}", *ends[name]), sum(parts), 100.0)


# --- a telescopic post with a held arm and a welded tip: one wrench after the other ---


def post():
    frame = Frame()
    tilt = np.array([0.5, -0.3, 0.8])  # the post's axes; its z axis is the slide
    R = Rotation.from_rotvec(tilt)
    up = R.apply([0, 0, 1.0])
    shoulder = 0.9 * up + [0.2, 0.1, 0]
    elbow, end = shoulder + [0.6, 0.2, -0.3], shoulder + [0.9, 0.8, 0.4]
    frame.body("post", 0.4 * up, [0.1, 0.2, 0.3], 5.0, 0.6 * up)
    frame.body("arm", shoulder, [1.0, -0.4, 0.2], 2.0, shoulder + [0.3, 0.1, 0])
    frame.body("tip", elbow, [-0.6, 0.5, 1.4], 1.0, elbow + [0.1, 0.3, 0.2])
    turned = (
        Rotation.from_rotvec([0.4, 0.9, -0.2]) * Rotation.from_rotvec([0, 0, 0.7])
    ).as_rotvec()
    ends = {
        "slide": (frame.marker("ground", "foot", 0.1 * up, tilt),
                  frame.marker("post", "head", 0.5 * up, tilt)),
        "hinge": (frame.marker("post", "shoulder", shoulder, [0.4, 0.9, -0.2]),
                  frame.marker("arm", "shoulder", shoulder, turned)),
        "weld": (frame.marker("tip", "elbow", elbow, [1.0, 1.0, 1.0]),
                 frame.marker("arm", "elbow", elbow, [1.0, 1.0, 1.0])),
    }  # fmt: skip
    frame.load("tip", "force", [10, -20, 30], end)
    frame.load("tip", "torque", [1, 2, -3], elbow, [0.3, 0.2, 0.1])
    frame.load("arm", "force", [-5, 4, 3], shoulder + [0.2, 0, 0], [0.7, -0.1, 0.5])
    frame.load("post", "torque", [2, -4, 6], up)
    return held(frame, ends)


def bracket():
    """The same in the plane: a carriage on a slanted guide, a held arm, a welded tip."""
    frame = Frame("xy")
    z = lambda angle: [0, 0, angle]  # noqa: E731
    along = np.array([np.cos(0.5), np.sin(0.5), 0])
    shoulder, elbow, end = np.array([[0.6, 0.8, 0], [1.3, 1.1, 0], [1.5, 0.4, 0]])
    frame.body("post", 0.4 * along, z(0.3), 5.0, 0.6 * along)
    frame.body("arm", shoulder, z(1.0), 2.0, shoulder + [0.3, 0.1, 0])
    frame.body("tip", elbow, z(-0.6), 1.0, elbow + [0.1, 0.3, 0])
    lying = (Rotation.from_rotvec(z(0.5)) * Rotation.from_rotvec([0, np.pi / 2, 0])).as_rotvec()
    ends = {
        "slide": (frame.marker("ground", "foot", 0.1 * along, lying),
                  frame.marker("post", "head", 0.5 * along, lying)),
        "hinge": (frame.marker("post", "shoulder", shoulder, z(0.4)),
                  frame.marker("arm", "shoulder", shoulder, z(1.1))),
        "weld": (frame.marker("tip", "elbow", elbow, z(2.0)),
                 frame.marker("arm", "elbow", elbow, z(2.0))),
    }  # fmt: skip
    for marker in ends["slide"]:  # in a plane x is along the slide and z normal to the plane
        frame.axes[marker] = Rotation.from_rotvec(z(0.5)).as_matrix()
    frame.load("tip", "force", [10, -20, 0], end)
    frame.load("tip", "torque", [0, 0, -3], elbow)
    frame.load("arm", "force", [-5, 4, 0], shoulder + [0.2, 0, 0], z(0.7))
    frame.load("post", "torque", [0, 0, 6], along)
    return held(frame, ends)


def held(frame, ends):
    """Joints on these markers, and a driver for every freedom."""
    for name, kind in (("slide", "prismatic"), ("hinge", "revolute"), ("weld", "fixed")):
        frame.made.add_joint(name, kind, between=list(ends[name]))
    frame.made.add_driver("jack", joint="slide", stroke="0.4")
    frame.made.add_driver("servo", joint="hinge", angle="0.7")
    return frame, ends


@pytest.mark.parametrize(("scene", "slide"), [(post, 2), (bracket, 0)])
def test_post_arm_and_tip(scene, slide):
    """Every joint carries what is beyond it; its driver the share along or about its axis."""
    frame, ends = scene()
    result = frame.solve()
    carried = {
        "slide": -frame.on("post", "arm", "tip"), "hinge": -frame.on("arm", "tip"),
        "weld": frame.on("tip"),  # J is the arm's
    }  # fmt: skip
    drivers = {"slide": "jack", "hinge": "servo", "weld": None}
    for name, wanted in carried.items():
        found = np.array(reported(frame, result, f"joints.{name}", *ends[name]))
        if drivers[name] is not None:
            own = reported(frame, result, f"drivers.{drivers[name]}", *ends[name])
            compare(own, own[0], 100.0)
            found += own
        compare(found, wanted, 100.0)
    tables = result.reactions[-1].reshape(-1, 4, 3)
    at = {path: tables[k] for k, path in enumerate(result.layout.reactions)}
    nothing = np.zeros(3)
    for force, moment in ((0, 1), (2, 3)):
        # What the joint leaves free its driver bears alone, and nothing else.
        jack, servo = np.zeros(3), np.zeros(3)
        jack[slide], servo[2] = at["drivers.jack"][force][slide], at["drivers.servo"][moment][2]
        assert abs(jack[slide]) > 1 and abs(servo[2]) > 1
        close(at["drivers.jack"][[force, moment]], [jack, nothing])
        close(at["drivers.servo"][[force, moment]], [nothing, servo])
        close(at["joints.slide"][force][slide], 0)
        close(at["joints.hinge"][moment][2], 0)
    # The moments at both ends of the slide differ by the arm between them.
    arm = frame.place["post.head"] - frame.place["ground.foot"]
    bent = np.cross(arm, frame.axes["post.head"] @ at["joints.slide"][0])
    assert np.linalg.norm(bent) > 1


# --- a flexible cantilever: equilibrium in its bent shape ---


def test_bent_cantilever():
    """The weld bears −F and −r×F for the bent place r of the tip, and with weight its W/2 arm.

    In equilibrium from the start, and it stays so.
    """
    bar = reduce(
        line(8, end=(1.0, 0, 0)), material={"E": 2.1e11, "nu": 0.3, "density": 7800.0},
        interfaces={"root": "root", "tip": "tip"}, modes=6,
        sections={"all": rectangle(0.012, 0.02)},
    )  # fmt: skip
    made = Model("cantilever")
    made.add_body("bar", bar)
    made.add_joint("weld", "fixed", between=["ground", "bar.root"])
    force = np.array([3.0, -5.0, 2.0])
    made.add_force("tip", "force", at="bar.tip", value=force.tolist())
    made.add_sensor("tip", "position", of="bar.tip")
    knobs = {"duration": 0.01, "step": 1e-4, "outputs": 10, "start": "quasi-static"}
    bent = run(made, newton_tolerance=1e-10, **knobs)
    place = bent.vector("tip")
    assert np.abs(place - [1, 0, 0]).max() > 1e-3
    wanted = np.hstack([np.tile(-force, (11, 1)), -np.cross(place, force)])
    np.testing.assert_allclose(bent.reactions[:, :6], wanted, rtol=0, atol=1e-8 * 5)
    np.testing.assert_allclose(bent.reactions[:, 6:], -wanted, rtol=0, atol=1e-8 * 5)
    made.set_gravity([0, -G, 0])
    heavy = run(made, newton_tolerance=1e-10, **knobs).reactions[:, :6]
    weight = bar.mass * G
    np.testing.assert_allclose(heavy[:, :3], [0, weight, 0] + wanted[:, :3], atol=1e-8 * weight)
    # Bent by some millimetres, its centre has come nearer by the square of that.
    np.testing.assert_allclose(heavy[:, 5], weight / 2 + 5.0, rtol=2e-3)


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9 * 100)


def link_on_a_rod(length, mass):
    """A rod 1/150 as thick as long on a ball joint, and a link of a mass [kg] on its end."""
    made = Model("link on a rod", gravity=[0, -G, 0])
    made.add_body("rod", rod(length / 150, length, 6, **STIFFENED), **STIFFENED)
    inertia = [mass * length**2 * part for part in (0.02, 1 / 12, 1 / 12)]
    made.add_body("link", mass=mass, center=[length / 2, 0, 0], inertia=inertia,
                  position=[length, 0, 0])  # fmt: skip
    made.add_joint("pivot", "spherical", between=["ground", "rod.root"])
    made.add_joint("elbow", "spherical", between=["rod.tip", "link"])
    made.add_sensor("link", "position", of="link")
    return made


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("length", "mass", "accuracy", "method"),
    [(0.3, 1.0, 5e-3, "radau"), (0.3, 1.0, 2e-3, "radau"), (0.5, 3.0, 1e-2, "radau"),
     (0.3, 1.0, 1e-3, "generalized-alpha")],
)  # fmt: skip
def test_reactions_of_a_thin_rod_between_balls(length, mass, accuracy, method):
    """Of long steps the matrix of reported reactions was singular: the rod turns about itself by
    next to no inertia, against which its loads act. They were up to half their range off, 5e4 times
    it was told, or the rod was said to buckle."""
    knobs = {"duration": 0.6, "outputs": 100}
    made = link_on_a_rod(length, mass)
    truth = run(made, accuracy=1e-9, method="explicit-rk", verify=False, **knobs)
    found = run(made, accuracy=accuracy, method=method, **knobs)
    size = np.ptp(truth.reactions, axis=0).max()
    np.testing.assert_allclose(found.reactions, truth.reactions, rtol=0, atol=0.02 * size)
    assert found.statistics["measured_error_of_reactions"] < 0.05
