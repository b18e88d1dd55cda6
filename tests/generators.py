"""Seeded random bodies and mechanisms: chain, tree, star, loop; rigid, flexible, mixed.

Flexible bodies are clouds of point masses with arbitrary mode shapes, so every inertia integral is
an exact sum over the points and any of them can be checked point by point. Mechanisms are assembled
in their placed pose, and use every joint type, drivers, springs, follower and global loads.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexmb.flexbody import FlexBody, Interface, MembraneStiffness
from flexmb.model import Model

ROWS = {"revolute": 5, "spherical": 3, "prismatic": 5, "cylindrical": 4, "fixed": 6}
JOINT_TYPES = tuple(ROWS)
COORDINATES = {"revolute": ["angle"], "prismatic": ["stroke"], "cylindrical": ["angle", "stroke"]}
TOPOLOGIES = ("chain", "tree", "star", "loop")
BODIES = ("rigid", "flexible", "mixed")
FLEXIBLE = ("flexible", "stiffened", "constant", "partial", "stretching")


@dataclass(frozen=True)
class Cloud:
    """Point masses: mass (k,), place s (k, 3), mode shapes N (k, 3, m); stiffness and damping."""

    mass: np.ndarray
    s: np.ndarray
    N: np.ndarray
    K: np.ndarray
    D: np.ndarray

    @property
    def m(self):
        return self.N.shape[2]

    @property
    def center(self):
        return self.mass @ self.s / self.mass.sum()

    @property
    def inertia(self):
        """About the centre, undeformed."""
        d = self.s - self.center
        S = np.einsum("k,ka,kb->ab", self.mass, d, d)
        return np.trace(S) * np.eye(3) - S

    def rigid_fields(self):
        """What a scene says of the same points held together rigidly."""
        J = 0.5 * (self.inertia + self.inertia.T)
        return {"mass": self.mass.sum(), "center": list(self.center), "inertia": J.tolist()}

    def flexbody(self, name, interfaces=()):
        """The FlexBody of the cloud."""
        return FlexBody(
            name,
            self.mass.sum(),
            self.mass @ self.s,
            np.einsum("k,ka,kb->ab", self.mass, self.s, self.s),
            np.einsum("k,kbi->bi", self.mass, self.N),
            np.einsum("k,ka,kbi->abi", self.mass, self.s, self.N),
            np.einsum("k,kai,kbj->abij", self.mass, self.N, self.N),
            self.K,
            self.D,
            tuple(interfaces),
        )


def cloud(rng, m=0, points=8):
    """A random cloud with m modes, about 1 m and 2 kg."""
    N = 0.5 * rng.standard_normal((points, 3, m))
    L, R = rng.standard_normal((2, m, m))
    return Cloud(
        rng.uniform(0.1, 0.4, points),
        rng.standard_normal((points, 3)) * (0.6, 0.4, 0.3) + rng.standard_normal(3) * 0.2,
        N,
        40.0 * (L @ L.T + 0.5 * np.eye(m)),
        0.3 * R @ R.T,
    )


def interface(rng, name, m):
    """An interface anywhere; its rotations per unit modal coordinate are as large as its motion."""
    shapes = rng.standard_normal((2, 3, m))
    return Interface(name, 0.5 * rng.standard_normal(3), 0.5 * shapes[0], shapes[1])


def stiffened(rng, body):
    """The body with any geometric stiffness: of centrifugal loads, and of loads at interfaces.

    Of the first interface moments about one axis have one.
    """

    def forms(*shape):
        values = 0.1 * rng.standard_normal((*shape, body.m, body.m))
        return values + values.swapaxes(-1, -2)

    centrifugal = forms(3, 3)
    bends = [forms(6) for _ in body.interfaces]
    bends[0][3:] = rng.standard_normal(3)[:, None, None] * forms()
    return replace(
        body,
        centrifugal_stiffness=centrifugal + centrifugal.swapaxes(0, 1),
        interfaces=tuple(
            replace(part, bend=bend) for part, bend in zip(body.interfaces, bends, strict=True)
        ),
    )


def stretching(rng, body):
    """The body with any energy of second-order strains in two combinations of its modes."""
    L = rng.standard_normal((3, 3))
    stiffness = MembraneStiffness(
        rng.standard_normal((2, body.m)), 0.3 * rng.standard_normal((body.m, 3)), 2.0 * L @ L.T
    )
    return replace(body, membrane_stiffness=stiffness)


def random_rotation(rng):
    """Rotation matrix, uniform over the group."""
    Q, R = np.linalg.qr(rng.standard_normal((3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * np.linalg.det(Q)


def edges(rng, topology, n):
    """Pairs of bodies that share a joint, −1 being ground."""
    if topology == "star":
        return [(-1, 0)] + [(0, k) for k in range(1, n)]
    if topology == "tree":
        return [(-1, 0)] + [(int(rng.integers(0, k)), k) for k in range(1, n)]
    chain = [(k - 1, k) for k in range(n)]
    return [*chain, (n - 1, -1)] if topology == "loop" else chain


class Mechanism:
    """A random model and how it was made.

    Parameters
    ----------
    seed : int
        The same numbers for the same seed.
    topology, bodies : str
        One of TOPOLOGIES and of BODIES; or "modeless" for flexible bodies with no modes.
    n : int
        Number of bodies.
    acting : bool
        With drivers (as far as there is freedom for them), springs, loads and gravity.
    turn, shift : (3, 3), (3,)
        The whole world turned and shifted.
    """

    def __init__(
        self, seed, topology="tree", bodies="mixed", n=4, acting=True, turn=None, shift=(0, 0, 0)
    ):
        self.rng = np.random.default_rng(seed)
        self.turn = np.eye(3) if turn is None else turn
        self.shift = np.asarray(shift, float)
        self.model = Model(f"{topology} of {bodies} bodies")
        self.bodies = bodies
        self.clouds = {}
        self.pose = {}
        for k in range(n):
            flexible = bodies in FLEXIBLE or (bodies == "mixed" and k % 2 == 1)
            self._body(f"b{k}", 3 + k % 2 if flexible else 0)
        joints = edges(self.rng, topology, n)
        first = int(self.rng.integers(len(JOINT_TYPES)))
        for k, pair in enumerate(joints):
            self._joint(f"j{k}", JOINT_TYPES[(first + k) % len(JOINT_TYPES)], pair)
        if acting:
            self._act(n)

    def _body(self, name, m):
        rng = self.rng
        r, A = rng.standard_normal(3), random_rotation(rng)
        self.pose[name] = r, A
        place = {
            "position": list(self.turn @ r + self.shift),
            "orientation": (self.turn @ A).tolist(),
        }
        made = self.clouds[name] = cloud(rng, m)
        if self.bodies == "modeless":
            nothing = np.zeros((3, 0))
            ends = [Interface("a", np.zeros(3), nothing, nothing)]
            self.model.add_body(name, made.flexbody(name, ends), **place)
        elif m:
            body = made.flexbody(name, [interface(rng, end, m) for end in ("a", "b", "c")])
            body = stiffened(np.random.default_rng(m), body) if self.bodies == "stiffened" else body
            if self.bodies == "stretching":
                body = stretching(np.random.default_rng(m), body)
                place["membrane_forces"] = "full"
            coupling = self.bodies if self.bodies in ("constant", "partial") else "full"
            self.model.add_body(name, body, inertia_coupling=coupling, **place)
        else:
            self.model.add_body(name, **made.rigid_fields(), **place)

    def marker(self, body, name, x, R=None):
        """A marker at point x with axes R, both of the unturned world; its reference."""
        R = np.eye(3) if R is None else R
        if body < 0:
            place = {"position": self.turn @ x + self.shift, "orientation": self.turn @ R}
            owner = "ground"
        else:
            owner = f"b{body}"
            r, A = self.pose[owner]
            place = {"position": A.T @ (x - r), "orientation": A.T @ R}
            if self.bodies == "modeless":
                place["interface"] = "a"
            elif self.clouds[owner].m:
                place["interface"] = "abc"[self.rng.integers(3)]
        place = {key: np.asarray(value).tolist() for key, value in place.items()}
        self.model.add_marker(f"{owner}.{name}", **place)
        return f"{owner}.{name}"

    def _joint(self, name, kind, pair):
        x, R = self.rng.standard_normal(3), random_rotation(self.rng)
        between = [self.marker(body, name, x, R) for body in pair]
        self.model.add_joint(name, kind, between=between)

    def _act(self, n):
        model, rng = self.model, self.rng
        model.set_gravity(list(self.turn @ [1.0, -2.0, -9.0]))
        freedom = 6 * n - sum(ROWS[joint.type] for joint in model.joints.values())
        coordinates = [
            (name, coordinate)
            for name, joint in model.joints.items()
            for coordinate in COORDINATES.get(joint.type, ())
        ]
        motions = {"angle": "0.3*sin(2*t) + 0.1*t", "stroke": "0.2*t**2 - 0.1*t"}
        for name, coordinate in coordinates[: max(0, freedom)]:
            model.add_driver(
                f"{coordinate}_{name}", joint=name, **{coordinate: motions[coordinate]}
            )
        for k in range(n):
            pair = [(k + 1) % n if k + 1 < n else -1, k]
            ends = [self.marker(b, f"s{k}{b + 1}", rng.standard_normal(3)) for b in pair]
            model.add_force(
                f"spring{k}", "spring-damper", between=ends,
                stiffness=30.0, damping=2.0, free_length=0.5,
            )  # fmt: skip
            at = self.marker(k, f"f{k}", rng.standard_normal(3), random_rotation(rng))
            for axes in ("global", "body"):
                for kind in ("force", "torque"):
                    value = self._turned("3*cos(t)", "2 + t", "-1", axes)
                    model.add_force(f"{kind}_{axes}{k}", kind, at=at, value=value, axes=axes)
        angular = [
            name for name, j in model.joints.items() if j.type in ("revolute", "cylindrical")
        ]
        for kind in ("position", "velocity", "acceleration"):
            model.add_sensor(kind, kind, of=at)
            model.add_sensor(f"relative_{kind}", kind, of=at, relative_to=ends[0])
        for name in angular:
            model.add_sensor(f"angle_{name}", "angle", joint=name)

    def _turned(self, x, y, z, axes):
        """Components of a vector of functions, in the turned world where axes are global."""
        if axes == "body":
            return [x, y, z]
        return [f"({a!r})*({x}) + ({b!r})*({y}) + ({c!r})*({z})" for a, b, c in self.turn.tolist()]
