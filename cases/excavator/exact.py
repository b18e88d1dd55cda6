"""The excavator by its geometry: its tooth's path, its cylinders' forces, the boom's bending.

Angles by the law of cosines; forces by virtual power of all mass points, each rigid body being six
points with its moments of inertia; the boom's bending by Castigliano's theorem.
"""

import numpy as np

G = 9.80665
# pins in the placed pose
FOOT, ARM, BUCKET, ROCKER, KNEE, LINK = (
    np.array(p) for p in ((0.3, 0.8), (4.2, 3.0), (5.6, 0.6), (5.3, 1.1), (5.9, 1.3), (6.05, 0.75))
)
CYLINDERS = np.array([[(0.9, 0.5), (2.2, 2.3)], [(2.6, 2.9), (4.0, 3.5)], [(4.5, 3.2), KNEE]])
TOOTH = BUCKET + (-0.05, -0.75)
# the boom: centre line, box section of 8 mm plates
LINE = FOOT + np.array([(0, 0), (1.75, 1.55), (2.35, 1.85), (3.9, 2.2)])
Y, Z, WALL = 0.36, 0.28, 0.008
AREA = Y * Z - (Y - 2 * WALL) * (Z - 2 * WALL)
IZ = (Z * Y**3 - (Z - 2 * WALL) * (Y - 2 * WALL) ** 3) / 12
IY = (Y * Z**3 - (Y - 2 * WALL) * (Z - 2 * WALL) ** 3) / 12
E, DENSITY = 210e9, 7850.0


def step5(t, t0, y0, t1, y1):
    """The 3-4-5 polynomial."""
    s = np.clip((t - t0) / (t1 - t0), 0, 1)
    return y0 + (y1 - y0) * s**3 * (10 - 15 * s + 6 * s * s)


PLACED = np.hypot(*(CYLINDERS[:, 1] - CYLINDERS[:, 0]).T)


def coordinates(t):
    """Slewing angle and lengths of the cylinders of boom, arm and bucket."""
    return np.array([
        step5(t, 6.5, 0, 9, np.radians(80)),
        PLACED[0] + step5(t, 0, 0, 2, 2.0 - PLACED[0]) + step5(t, 5.5, 0, 7, 0.55),
        PLACED[1] + step5(t, 2, 0, 4.5, 1.85 - PLACED[1]),
        PLACED[2] + step5(t, 3, 0, 4.5, 2.6 - PLACED[2]) - step5(t, 9, 0, 10, 0.3),
    ])  # fmt: skip


def soil(t):
    """Force on the tooth along the global x."""
    return 10e3 * (step5(t, 2, 0, 2.5, 1) - step5(t, 4, 0, 4.5, 1))


def load(t):
    """Weight in the bucket."""
    return 8e3 * (step5(t, 4, 0, 4.5, 1) - step5(t, 9, 0, 10, 1))


def turn(angle):
    """Rotation in the plane."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def cross(a, b):
    """The component across the plane."""
    return a[0] * b[1] - a[1] * b[0]


def opening(k, pivot, length):
    """By how much the triangle of cylinder k at a pivot opens from the placed pose."""
    a, b = (np.hypot(*(end - pivot)) for end in CYLINDERS[k])
    return np.arccos((a * a + b * b - length**2) / (2 * a * b)) - np.arccos(
        (a * a + b * b - PLACED[k] ** 2) / (2 * a * b)
    )


def poses(q):
    """Of house, boom, arm, rocker, link, bucket: the pin as placed, where it is now, rotation."""
    boom = turn(opening(0, FOOT, q[1]))
    arm_pin = FOOT + boom @ (ARM - FOOT)
    arm = boom @ turn(-opening(1, ARM, q[2]))

    def on_arm(point):
        return arm_pin + arm @ (point - ARM)

    rocker = turn(-opening(2, ROCKER, q[3]))  # relative to the arm, as all below
    knee = ROCKER + rocker @ (KNEE - ROCKER)
    # the pin of link and bucket: on a circle about the bucket's pin and on one about the knee
    r, c, e = np.hypot(*(LINK - BUCKET)), np.hypot(*(LINK - KNEE)), knee - BUCKET
    along = (r * r + e @ e - c * c) / (2 * (e @ e))
    pin = BUCKET + along * e + np.sqrt(r * r / (e @ e) - along**2) * np.array([e[1], -e[0]])

    def rotation(before, after):
        c, s = before @ after / (before @ before), cross(before, after) / (before @ before)
        return np.array([[c, -s], [s, c]])

    bucket, link = rotation(LINK - BUCKET, pin - BUCKET), rotation(LINK - KNEE, pin - knee)
    return [
        (np.zeros(2), np.zeros(2), np.eye(2)),
        (FOOT, FOOT, boom),
        (ARM, arm_pin, arm),
        (ROCKER, on_arm(ROCKER), arm @ rocker),
        (KNEE, on_arm(knee), arm @ link),
        (BUCKET, on_arm(BUCKET), arm @ bucket),
    ]


def box(mass, size):
    """Moments of inertia of a box."""
    x, y, z = np.square(size)
    return mass / 12 * np.array([y + z, x + z, x + y])


def body_points():
    """For each body: masses (n,) and places (n, 3) in the placed pose."""
    bodies = []
    for mass, center, inertia in (
        (6000.0, (-0.7, 0.2), box(6000.0, (2.4, 0.7, 1.8))),
        (500.0, ARM + (0.5, -0.9), (300.0, 120.0, 400.0)),
        (40.0, ROCKER + (0.3, 0.1), (1.0, 2.5, 3.0)),
        (40.0, KNEE + (0.075, -0.275), (2.0, 1.0, 2.5)),
        (400.0, BUCKET + (0.3, -0.35), box(400.0, (0.7, 0.7, 0.9))),
    ):
        second = np.sum(inertia) / 2 - np.array(inertia)  # integrals of x^2, y^2, z^2
        arms = np.diag(np.sqrt(3 * second / mass))
        bodies.append((np.full(6, mass / 6), np.append(center, 0) + np.vstack([arms, -arms])))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    masses, places = [], []
    for a, b in zip(LINE[:-1], LINE[1:], strict=True):
        span = np.hypot(*(b - a))
        normal = np.append([a[1] - b[1], b[0] - a[0]], 0) / span * np.sqrt(2 * IZ / AREA)
        across = np.array([0, 0, np.sqrt(2 * IY / AREA)])
        for x, w in zip(nodes, weights, strict=True):
            middle = np.append((a + b) / 2 + x * (b - a) / 2, 0)
            places += [middle + normal, middle - normal, middle + across, middle - across]
            masses += [DENSITY * AREA * span * w / 8] * 4
    bodies.insert(1, (np.array(masses), np.array(places)))
    return bodies


BODIES = body_points()
MASS = np.concatenate([m for m, _ in BODIES])
LOAD_POINT = BUCKET + (0.3, -0.35)


def points(q):
    """All mass points, then tooth and middle of the bucket, (n, 3)."""
    placed = [*(p for _, p in BODIES), np.array([[*TOOTH, 0], [*LOAD_POINT, 0]])]
    flat = []
    turns = poses(q)
    for (pin, at, R), p in zip([*turns, turns[5]], placed, strict=True):
        flat.append(np.column_stack([at + (p[:, :2] - pin) @ R.T, p[:, 2]]))
    x, y, z = np.vstack(flat).T
    c, s = np.cos(q[0]), np.sin(q[0])
    return np.column_stack([x * c + z * s, y, z * c - x * s])


def driving_forces(t):
    """Torque of the slewing ring, and forces with which the cylinders push."""
    q, h = coordinates(t), 2e-3
    J = np.stack([points(q + 1e-30j * e).imag / 1e-30 for e in np.eye(4)], axis=-1)
    path = np.stack([points(coordinates(t + k * h)) for k in range(-2, 3)], axis=-1)
    force = path @ np.array([-1, 16, -30, 16, -1]) / (12 * h * h)
    force[:, 1] += G
    force[:-2] *= MASS[:, None]
    force[-2:] = [[-soil(t), 0, 0], [0, load(t), 0]]
    return np.einsum("nd,ndk->k", force, J)


def sag(t, direction):
    """Displacement of the tooth along a direction of the plane by the boom's bending, at rest."""
    q = coordinates(t)
    turns = poses(q)

    def where(k, point):
        pin, at, R = turns[k]
        return at + R @ (np.asarray(point) - pin)

    line = [where(1, p) for p in LINE]
    ends = [(CYLINDERS[0, 0], where(1, CYLINDERS[0, 1]))]
    ends.append((where(1, CYLINDERS[1, 0]), where(2, CYLINDERS[1, 1])))
    up = np.array([0.0, 1.0])

    def section_forces(loads, weight):
        """Moments and normal forces of loads [(point, force)] on the arm's group."""
        pin = where(1, ARM)
        moment = sum(cross(p - pin, f) for p, f in loads)
        along = (ends[1][1] - ends[1][0]) / q[2]
        push = -moment / cross(ends[1][1] - pin, along)  # of the arm's cylinder
        tip = [(pin, sum(f for _, f in loads) + push * along), (ends[1][0], -push * along)]
        if weight:
            tip += [
                ((a + b) / 2, -up * G * DENSITY * AREA * np.hypot(*(b - a)))
                for a, b in zip(line[:-1], line[1:], strict=True)
            ]
        foot = line[0]
        along = (ends[0][1] - ends[0][0]) / q[1]
        push = -sum(cross(p - foot, f) for p, f in tip) / cross(ends[0][1] - foot, along)
        at_foot = -sum(f for _, f in tip) - push * along
        M, N = [], []
        for k, (a, b) in enumerate(zip(line[:-1], line[1:], strict=True)):
            e, span = (b - a) / np.hypot(*(b - a)), np.hypot(*(b - a))
            for x in NODES:
                p = (a + b) / 2 + x * (b - a) / 2
                before = [(foot, at_foot)]  # the forces between the foot and this section
                before += [(ends[0][1], push * along)] if k > 0 else []
                before += [tip[1]] if k > 1 else []
                if weight:
                    before += tip[2 : 2 + k]
                    part = (x + 1) / 2
                    w = -up * G * DENSITY * AREA * span * part
                    before.append((a + part / 2 * (b - a), w))
                M.append(sum(cross(r - p, f) for r, f in before))
                N.append(sum(f for _, f in before) @ e)
        return np.array(M), np.array(N)

    weights = [(where(k, c), -m * G * up) for k, m, c in (
        (2, 500, ARM + (0.5, -0.9)), (3, 40, ROCKER + (0.3, 0.1)), (4, 40, KNEE + (0.075, -0.275)),
        (5, 400, BUCKET + (0.3, -0.35)))]  # fmt: skip
    weights.append((where(5, LOAD_POINT), -load(t) * up))
    M, N = section_forces(weights, weight=True)
    m, n = section_forces([(where(5, TOOTH), np.asarray(direction, float))], weight=False)
    lengths = np.repeat(np.hypot(*np.diff(LINE, axis=0).T), len(NODES)) / 2
    return float(np.sum((M * m / (E * IZ) + N * n / (E * AREA)) * lengths * np.tile(WEIGHTS, 3)))


NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)


def values():
    """Rows (scene, sensor, time, value) for the checks."""
    for t in (1.0, 3.8, 8.0):
        tooth = points(coordinates(t))[-2]
        for scene in ("scene.toml", "universal.toml", "revolute.toml"):
            for axis, x in zip("xyz", tooth, strict=True):
                yield scene, f"tooth.{axis}", t, x
        torque, *forces = driving_forces(t)
        for name, force in zip(("boom", "arm", "bucket"), forces, strict=True):
            yield "scene.toml", f"{name}_push", t, force
        yield "scene.toml", "slew_torque.z", t, round(torque, 6)
    for t in (5.4, 11.0):
        q = coordinates(t)
        x, y, z = points(q)[-2]
        yield "flexible.toml", "tooth.y", t, y + sag(t, (0, 1))
        yield "flexible.toml", "reach", t, np.hypot(x, z) + sag(t, (1, 0))


if __name__ == "__main__":
    for scene, sensor, time, value in values():
        print(f"{scene} {sensor} {time:.12g} {value:.15g}")
