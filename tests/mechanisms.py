"""Mechanisms of the textbook and of the literature, by the kinds of their joints.

Each is a function that makes a model in a closed pose; joints are R (revolute), T (prismatic),
C (cylindrical), U (universal), S (spherical). Lengths, masses and poses are our own; what the tests
take from literature are counts of equations, rank and degrees of freedom.
"""

from __future__ import annotations

import numpy as np

from flexmb.model import Model

X, Y, Z = np.eye(3).tolist()


class Sketch:
    """A model whose bodies and joints are given by global points of the placed pose."""

    def __init__(self, title, plane=None, gravity="earth -y"):
        self.model = Model(title, plane=plane, gravity=gravity)
        self.at = {"ground": np.zeros(3)}
        self.plane = plane

    def body(self, name, at, mass=1.0, **fields):
        """A body whose frame and centre of mass are at a point."""
        self.at[name] = np.array(at, float)
        fields = {"inertia": [0.1, 0.12, 0.14], **fields}
        self.model.add_body(name, mass=mass, position=list(self.at[name]), **fields)

    def marker(self, body, point):
        """Reference to a marker of a body at a global point."""
        name = f"p{len(self._markers(body))}"
        place = (np.array(point, float) - self.at[body]).tolist()
        self.model.add_marker(f"{body}.{name}", position=place)
        return f"{body}.{name}"

    def _markers(self, body):
        return self.model.ground.markers if body == "ground" else self.model.bodies[body].markers

    def joint(self, name, kind, first, second, at, to=None, **fields):
        """A joint between two bodies at a global point, of a link from one point to another."""
        ends = [self.marker(first, at), self.marker(second, at if to is None else to)]
        fields = {key: np.asarray(value).tolist() for key, value in fields.items()}
        self.model.add_joint(name, kind, between=ends, **fields)


def crank_slider(kind="RSUT", angle=0.7, driven=False):
    """Crank, rod and slider in space; the slider's line lies 0.1 m beside the crank's plane.

    ``kind`` names main bearing, crank pin, wrist pin and guide, such as "RSUT"; "R-T" has a rod
    without mass. The kinds whose joints are all revolute or prismatic lie in one plane.
    """
    flat = kind in ("RRRT", "RSCT", "RRCT", "RIRT")
    sketch = Sketch(f"crank-slider {kind}")
    pin = 0.15 * np.array([np.cos(angle), np.sin(angle), 0])
    side = 0.0 if flat else 0.1
    end = np.array([pin[0] + np.sqrt(0.45**2 - pin[1] ** 2 - side**2), 0, side])
    sketch.body("crank", pin / 2)
    sketch.joint("bearing", "revolute", "ground", "crank", [0, 0, 0], axis=Z)
    sketch.body("slider", end)
    if kind == "R-T":
        sketch.joint("rod", "distance", "crank", "slider", pin, end)
    else:
        sketch.body("rod", (pin + end) / 2)
        along = (end - pin) / np.linalg.norm(end - pin)
        across = np.cross(along, Z) / np.linalg.norm(np.cross(along, Z))
        axes = {
            "R": ("revolute", {"axis": Z}),
            "C": ("cylindrical", {"axis": Z}),
            "I": ("in-line", {"axis": Z}),
            "S": ("spherical", {}),
            "U": ("universal", {"axis": across, "second_axis": np.cross(along, across)}),
        }
        for name, letter, pair, at in (
            ("pin", kind[1], ("crank", "rod"), pin),
            ("wrist", kind[2], ("rod", "slider"), end),
        ):
            sketch.joint(name, axes[letter][0], *pair, at, **axes[letter][1])
    sketch.joint("guide", "prismatic", "ground", "slider", end, axis=X)
    if driven:
        sketch.model.add_driver("motor", joint="bearing", angle="10*t")
    return sketch.model


# Points of an excavator in its plane x, y: where its parts are joined, m.
_DIGGER = {
    "slew": (0, 0), "boom": (0.3, 0.8), "arm": (4.2, 3.0), "bucket": (5.6, 0.6),
    "rocker": (5.3, 1.1), "knee": (5.9, 1.3), "tooth": (6.05, 0.75),
    "boom_low": (0.9, 0.5), "boom_high": (2.2, 2.3), "arm_low": (2.6, 2.9), "arm_high": (4.0, 3.5),
    "bucket_low": (4.5, 3.2),
}  # fmt: skip
_CYLINDERS = {  # name: bodies and points at the two ends
    "boom_cylinder": ("house", "boom_low", "boom", "boom_high"),
    "arm_cylinder": ("boom", "arm_low", "arm", "arm_high"),
    "bucket_cylinder": ("arm", "bucket_low", "rocker", "knee"),
}


def excavator(cylinders="RTR"):
    """An excavator: house, boom, arm, bucket, rocker, link and three cylinders with rods.

    ``cylinders``: "RTR" with all pins revolute; "UCU" with a bucket link that is pinned without
    redundancy; "distance": of constant length, without bodies; "none": left out.
    """
    sketch = Sketch(f"excavator, cylinders {cylinders}")
    at = {name: np.array([x, y, 0.0]) for name, (x, y) in _DIGGER.items()}
    for name, where in (
        ("house", "slew"), ("boom", "boom"), ("arm", "arm"), ("bucket", "bucket"),
        ("rocker", "rocker"), ("link", "tooth"),
    ):  # fmt: skip
        sketch.body(name, at[where], mass=100.0, inertia=[50.0, 60.0, 70.0])
    sketch.joint("slew", "revolute", "ground", "house", at["slew"], axis=Y)
    pins = [("boom", "house", "boom"), ("arm", "boom", "arm"), ("bucket", "arm", "bucket")]
    for where, first, second in [*pins, ("rocker", "arm", "rocker")]:
        sketch.joint(f"{where}_pin", "revolute", first, second, at[where], axis=Z)
    sketch.joint("knee_pin", "revolute", "rocker", "link", at["knee"], axis=Z)
    last = "revolute" if cylinders == "RTR" else "in-line"
    sketch.joint("tooth_pin", last, "link", "bucket", at["tooth"], axis=Z)
    for name, (first, a, second, b) in _CYLINDERS.items():
        if cylinders != "none":
            _cylinder(sketch, name, cylinders, (first, at[a]), (second, at[b]))
    return sketch.model


def _cylinder(sketch, name, kind, first, second):
    """A cylinder with its rod between two (body, point)."""
    (lower, a), (upper, b) = first, second
    if kind == "distance":
        sketch.joint(name, "distance", lower, upper, a, b)
        return
    along = (b - a) / np.linalg.norm(b - a)
    sketch.body(name, a + 0.3 * (b - a), mass=20.0, inertia=[1.0, 1.1, 1.2])
    sketch.body(f"{name}_rod", a + 0.7 * (b - a), mass=10.0, inertia=[1.0, 1.1, 1.2])
    pin = ("revolute", {"axis": Z})
    if kind == "UCU":
        pin = ("universal", {"axis": Z, "second_axis": np.cross(Z, along)})
    slide = "prismatic" if kind == "RTR" else "cylindrical"
    sketch.joint(f"{name}_foot", pin[0], lower, name, a, **pin[1])
    sketch.joint(f"{name}_slide", slide, name, f"{name}_rod", (a + b) / 2, axis=along)
    if kind == "UCU":
        pin = ("universal", {"axis": np.cross(Z, along), "second_axis": Z})
    sketch.joint(f"{name}_head", pin[0], f"{name}_rod", upper, b, **pin[1])


def stewart(legs="UTS"):
    """A platform on six legs: universal joint, slide T or C, spherical joint; "distance": rods."""
    sketch = Sketch(f"platform on legs {legs}", gravity="earth -z")
    sketch.body("platform", [0, 0, 1.2], mass=20.0)
    for k in range(6):
        corner = 2 * np.pi * (k // 2) / 3
        low, high = corner + (-1) ** k * 0.25, corner + (-1) ** k * 0.8
        a = np.array([1.1 * np.cos(low), 1.1 * np.sin(low), 0])
        b = np.array([0.6 * np.cos(high), 0.6 * np.sin(high), 1.2])
        if legs == "distance":
            sketch.joint(f"leg{k}", "distance", "ground", "platform", a, b)
            continue
        along = (b - a) / np.linalg.norm(b - a)
        first = np.cross(along, Z) / np.linalg.norm(np.cross(along, Z))
        sketch.body(f"lower{k}", a + 0.25 * (b - a))
        sketch.body(f"upper{k}", a + 0.75 * (b - a))
        axes = {"axis": first, "second_axis": np.cross(along, first)}
        sketch.joint(f"foot{k}", "universal", "ground", f"lower{k}", a, **axes)
        slide = "prismatic" if legs == "UTS" else "cylindrical"
        sketch.joint(f"slide{k}", slide, f"lower{k}", f"upper{k}", (a + b) / 2, axis=along)
        sketch.joint(f"head{k}", "spherical", f"upper{k}", "platform", b)
    return sketch.model


def quick_return(model="A", driven=False):
    """The quick-return mechanism in its plane: models A, B, C of the same motion.

    A: crank, block, lever, link, ram. B: the block is a pin in a slot. C: the link has no mass too.
    """
    sketch = Sketch(f"quick-return {model}", plane="xy")
    foot, crank = np.zeros(3), np.array([0, 0.35, 0])
    pin = crank + 0.12 * np.array([np.cos(0.6), np.sin(0.6), 0])
    along = pin / np.linalg.norm(pin)
    top = 0.7 * along
    ram = np.array([top[0] - np.sqrt(0.25**2 - (0.78 - top[1]) ** 2), 0.78, 0])
    sketch.body("crank", crank)
    sketch.body("lever", 0.5 * top)
    sketch.body("ram", ram)
    sketch.joint("crank_bearing", "revolute", "ground", "crank", crank, axis=Z)
    sketch.joint("lever_bearing", "revolute", "ground", "lever", foot, axis=Z)
    sketch.joint("ram_guide", "prismatic", "ground", "ram", ram, axis=X)
    if model == "A":
        sketch.body("block", pin)
        sketch.joint("block_pin", "revolute", "crank", "block", pin, axis=Z)
        sketch.joint("block_slide", "prismatic", "lever", "block", pin, axis=along)
    else:
        sketch.joint("slot", "prismatic-spherical", "lever", "crank", foot, pin, axis=along)
    if model == "C":
        sketch.joint("link", "distance", "lever", "ram", top, ram)
    else:
        sketch.body("link", (top + ram) / 2)
        sketch.joint("link_pin", "revolute", "lever", "link", top, axis=Z)
        sketch.joint("ram_pin", "revolute", "link", "ram", ram, axis=Z)
    if driven:
        sketch.model.add_driver("motor", joint="crank_bearing", angle="2*pi*t")
    return sketch.model


def ring(title, points, axes):
    """A closed ring of revolute joints at global points with global axes, one link on ground."""
    sketch = Sketch(title)
    n = len(points)
    for k in range(n - 1):
        sketch.body(f"link{k + 1}", (np.array(points[k]) + np.array(points[k + 1])) / 2)
    names = ["ground", *(f"link{k}" for k in range(1, n)), "ground"]
    for k in range(n):
        sketch.joint(f"hinge{k}", "revolute", names[k], names[k + 1], points[k], axis=axes[k])
    return sketch.model


def bricard():
    """Bricard's six-bar ring of 1 m links at right angles (IFToMM benchmark A04)."""
    points = [[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]]
    return ring("Bricard's ring", points, [Y, Z, X, Y, Z, X])


def bennett(theta=1.1, alpha=0.5, beta=1.2, a=0.4, skewed=0.0):
    """Bennett's ring of four skew hinges; ``skewed`` [rad] turns one axis out of its place.

    Opposite links are equal, of lengths a, b and twists α, β with sin α / a = sin β / b; then
    tan θ1/2 tan θ2/2 = sin((β + α)/2) / sin((β − α)/2) (G. T. Bennett, Engineering 76, 1903, 777).
    """
    b = a * np.sin(beta) / np.sin(alpha)
    ratio = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    second = 2 * np.arctan(ratio / np.tan(theta / 2))
    frame = np.eye(4)
    points, axes = [], []
    for angle, length, twist in (
        (theta, a, alpha), (second, b, beta), (-theta, a, alpha), (-second, b, beta),
    ):  # fmt: skip
        points.append(frame[:3, 3].copy())
        axes.append(frame[:3, 2].copy())
        frame = frame @ _hinge(angle, length, twist)
    np.testing.assert_allclose(frame, np.eye(4), atol=1e-12)
    axes[2] = np.cos(skewed) * axes[2] + np.sin(skewed) * np.cross(axes[2], points[2]) / (
        np.linalg.norm(np.cross(axes[2], points[2]))
    )
    return ring("Bennett's ring", points, axes)


def _hinge(angle, length, twist):
    """Denavit–Hartenberg transformation: turn about z, then length along x and twist about it."""
    c, s, d, e = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
    return np.array(
        [[c, -s * d, s * e, length * c], [s, c * d, -c * e, length * s], [0, e, d, 0], [0, 0, 0, 1]]
    )


def sarrus(height=0.6):
    """Sarrus' linkage: two hinged chains at right angles lift a plate without turning it.

    P. F. Sarrus, Comptes Rendus 36 (1853) 1036: six hinges, one freedom.
    """
    out = np.sqrt(0.5**2 - (height / 2) ** 2)
    points = [
        [1, 0, 0], [1 + out, 0, height / 2], [1, 0, height],
        [0, 1, height], [0, 1 + out, height / 2], [0, 1, 0],
    ]  # fmt: skip
    return ring("Sarrus' linkage", points, [Y, Y, Y, X, X, X])


def four_bar(tilt=0.0, driven=False, plane=None):
    """A planar four-bar linkage; in space one of its axes can be tilted [rad]."""
    sketch = Sketch("four-bar", plane=plane)
    points = np.array([[0, 0, 0], [0.1, 0.2, 0], [0.6, 0.5, 0], [0.7, 0, 0]])
    for k, name in enumerate(("crank", "coupler", "rocker")):
        sketch.body(name, (points[k] + points[k + 1]) / 2)
    names = ["ground", "crank", "coupler", "rocker", "ground"]
    for k, name in enumerate("ABCD"):
        axis = [np.sin(tilt), 0, np.cos(tilt)] if k == 2 else Z
        sketch.joint(name, "revolute", names[k], names[k + 1], points[k], axis=axis)
    if driven:
        sketch.model.add_driver("motor", joint="A", angle="3*t")
    return sketch.model


def planetary(rings=1):
    """Sun, planet and arm in the plane, the ring on ground; ``rings`` 2: a planet too many."""
    sketch = Sketch("planetary gear", plane="xy")
    planets = [("planet", [0.3, 0, 0]), ("planet_2", [-0.3, 0, 0])][:rings]
    for name, at in (("arm", [0, 0, 0]), ("sun", [0, 0, 0]), *planets):
        sketch.body(name, at)
    sketch.joint("arm_pin", "revolute", "ground", "arm", [0, 0, 0], axis=Z)
    sketch.joint("sun_pin", "revolute", "arm", "sun", [0, 0, 0], axis=Z)
    for name, at in planets:
        pin = f"{name}_pin"
        sketch.joint(pin, "revolute", "arm", name, at, axis=Z)
        mesh = {"joints": ["sun_pin", pin], "teeth": [20, 10]}
        sketch.model.add_coupler(f"{name}_sun", "gear", **mesh)
        mesh = {"joints": ["arm_pin", pin], "teeth": [40, 10], "internal": True}
        sketch.model.add_coupler(f"{name}_ring", "gear", **mesh)
    return sketch.model


def cam_valve():
    """Cam, rocker and valve: a cam that lifts a rocker's roller, the rocker a flat-footed valve."""
    sketch = Sketch("cam and valve", plane="xy")
    sketch.model.add_curve("cam", circle=0.03, center=[0.005, 0])
    sketch.model.add_curve("tip", circle=0.01)
    sketch.body("cam", [0, 0, 0])
    sketch.body("rocker", [0.05, 0.06, 0])
    sketch.body("valve", [0.1, 0.05, 0])
    sketch.joint("camshaft", "revolute", "ground", "cam", [0, 0, 0], axis=Z)
    sketch.joint("rocker_pin", "revolute", "ground", "rocker", [0.05, 0.06, 0], axis=Z)
    sketch.joint("valve_guide", "prismatic", "ground", "valve", [0.1, 0.05, 0], axis=Y)
    sketch.model.add_marker("rocker.roller", position=[-0.05, -0.02, 0])
    sketch.model.add_marker("rocker.tip", position=[0.05, 0, 0])
    lifted = {"between": ["cam", "rocker.roller"], "curve": "cam", "radius": 0.01}
    sketch.model.add_joint("lifter", "cam-roller", **lifted)
    pushed = {"between": ["rocker.tip", "valve"], "curve": "tip", "axis": Y}
    sketch.model.add_joint("foot", "cam-flat", **pushed)
    return sketch.model
