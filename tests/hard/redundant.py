"""Redundant constraints: loops that move in spite of their count, doors, leaf guides, nets."""

from __future__ import annotations

from functools import cache

import numpy as np
from femeshes import line
from scipy.integrate import solve_ivp
from truthkit import reference

from flexmb.fe import rectangle, reduce
from flexmb.model import Model
from tests.hard.case import Hard, largest

G = 9.81
RUN = {"duration": 2.0, "outputs": 40, "accuracy": 1e-5}
FIXED = {"accuracy": None, "step": 2e-3}
ALL = {
    "auto": {}, "generalized-alpha": FIXED, "explicit-rk": {}, "radau": {},
    "fixed explicit-rk": FIXED, "fixed radau": FIXED, "baumgarte": FIXED,
    "coordinate-partitioning": FIXED,
}  # fmt: skip


def bricard():
    """IFToMM A04: six hinges whose 30 equations leave one motion of 30 coordinates."""
    of = reference("mechanisms", "iftomm_A04_bricard")["params"]
    made, points = Model("Bricard", gravity=of["g"]), np.array(of["points"])
    for k, along in enumerate(np.diff(points, axis=0)):
        inertia = np.where(np.abs(along) > 0.5, 0.02, 1.01) / 12  # 1 kg, 1 m, 0.1 m square
        made.add_body(f"bar{k}", mass=1, center=list(along / 2), inertia=list(inertia),
                      position=list(points[k]))  # fmt: skip
        made.add_marker(f"bar{k}.end", position=list(along))
    made.add_marker("ground.end", position=list(points[5]))
    firsts = ["ground", *(f"bar{k}.end" for k in range(5))]
    seconds = [*(f"bar{k}" for k in range(5)), "ground.end"]
    for k, between in enumerate(zip(firsts, seconds, strict=True)):
        made.add_joint(f"hinge{k}", "revolute", between=list(between), axis="yzxyzx"[k])
    for k in range(1, 5):
        made.add_sensor(f"P{k}", "position", of=f"bar{k}")
    made.add_sensor("swing", "angle", joint="hinge0")
    return made


def off_bricard(run):
    """Points P1 to P4 of the reference, at 0.5, 1 and 2 s."""
    table = reference("mechanisms", "iftomm_A04_bricard")["values"]
    off = 0.0
    for time, row in table.items():
        at = np.flatnonzero(np.abs(run.time - float(time)) < 1e-9)
        for k in range(1, 5) if len(at) else ():
            now = [run[f"P{k}.{c}"][at[0]] for c in "xyz"]
            off = max(off, largest(np.subtract(now, row["points"][f"P{k}"])))
    return off


DOOR = {"mass": 20.0, "width": 0.9, "inertia": 20 * 0.9**2 / 3, "lean": 0.1}


def door(hinges=(0.3, 1.0, 1.8)):
    """A door on hinges whose common axis leans by 0.1 rad, opened by half a turn and let go."""
    lean = DOOR["lean"]
    made = Model("door", gravity=[G * np.sin(lean), 0, -G * np.cos(lean)])
    J = DOOR["mass"] * DOOR["width"] ** 2 / 12
    made.add_body("door", mass=DOOR["mass"], center=[DOOR["width"] / 2, 0, 1.0],
                  inertia=[DOOR["mass"] * 4 / 12, J + DOOR["mass"] * 4 / 12, J],
                  orientation={"axis": "z", "angle": 2.0})  # fmt: skip
    for k, height in enumerate(hinges):
        made.add_marker(f"ground.h{k}", position=[0, 0, height])
        made.add_marker(f"door.h{k}", position=[0, 0, height])
        made.add_joint(f"hinge{k}", "revolute", between=[f"ground.h{k}", f"door.h{k}"], axis="z")
        made.add_sensor(f"F{k}", "reaction", joint=f"hinge{k}", on="J", quantity="force",
                        axes="global")  # fmt: skip
    made.add_sensor("swing", "angle", joint="hinge0")
    return made


def off_door(run):
    """A pendulum in the slope of the axis; the hinges bear together m (a - g) of its centre."""
    half, m = DOOR["width"] / 2, DOOR["mass"]
    pull = G * np.sin(DOOR["lean"])
    rate = m * pull * half / DOOR["inertia"]
    y = solve_ivp(lambda _, y: [y[1], -rate * np.sin(y[0])], (0, run.time[-1]), [2.0, 0.0],
                  "DOP853", run.time, rtol=1e-12, atol=1e-12).y  # fmt: skip
    along, across = [np.cos(y[0]), np.sin(y[0])], [-np.sin(y[0]), np.cos(y[0])]
    a = -half * y[1] ** 2 * along + half * -rate * np.sin(y[0]) * across
    forces = [sum(run[f"F{k}.{c}"] for k in range(3)) for c in "xyz"]
    wanted = [m * (a[0] - pull), m * a[1], m * G * np.cos(DOOR["lean"]) + 0 * y[0]]
    swing = np.unwrap(run["swing"]) - run["swing"][0] + 2.0
    return max(largest(swing - y[0]), largest(np.subtract(forces, wanted)) / (m * G))


def four_bar(tilt=0.0):
    """A four-bar of spatial revolute joints, its last pin tilted by an angle [rad]."""
    made = Model("four-bar", gravity=[0.6 * G, -0.8 * G, 0])
    for name, at, along in (("crank", [0, 0], [0, 0.3]), ("coupler", [0, 0.3], [0.6, 0.2]),
                            ("rocker", [0.6, 0], [0, 0.5])):  # fmt: skip
        length = float(np.hypot(*along))
        made.add_body(name, mass=length, center=[*np.divide(along, 2), 0], position=[*at, 0],
                      inertia=[length**3 / 12] * 3)  # fmt: skip
        made.add_marker(f"{name}.end", position=[*along, 0])
    made.add_marker("ground.right", position=[0.6, 0, 0])
    made.add_joint("left", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "revolute", between=["crank.end", "coupler"], axis="z")
    made.add_joint("top", "revolute", between=["coupler.end", "rocker.end"],
                   axis=[np.sin(tilt), 0, np.cos(tilt)])  # fmt: skip
    made.add_joint("right", "revolute", between=["ground.right", "rocker"], axis="z")
    made.add_sensor("crank", "angle", joint="left")
    made.add_sensor("rocker", "angle", joint="right")
    return made


def off_four_bar(run):
    """The rocker as the crank's angle closes the loop, and kinetic energy as the weight's work."""
    x, y = -0.3 * np.sin(run["crank"]), 0.3 * np.cos(run["crank"])
    across, long2 = np.hypot(x - 0.6, y), 0.6**2 + 0.2**2
    inside = np.arccos((across**2 + 0.25 - long2) / across)  # of rocker and diagonal
    rocker = np.arctan2(y, x - 0.6) - inside
    tip = 0.6 + 0.5 * np.cos(rocker), 0.5 * np.sin(rocker)
    arm = [x * 0.3 / 2 + (x + tip[0]) / 2 * np.sqrt(long2) + (0.6 + tip[0]) / 4,
           y * 0.3 / 2 + (y + tip[1]) / 2 * np.sqrt(long2) + tip[1] / 4]  # fmt: skip
    work = G * (0.6 * (arm[0] - arm[0][0]) - 0.8 * (arm[1] - arm[1][0]))
    gap = largest(np.sin(rocker - np.pi / 2 - run["rocker"]))
    return max(gap, largest(run.energy["kinetic"] - work) / np.ptp(work))


def leaf_guides(n=20):
    """A block on n parallel leaves of steel, clamped at both ends, let go 0.1 mm aside."""
    made = Model("leaf guides")
    made.add_body("block", mass=5.0, inertia=[0.05] * 3)
    for k in range(n):
        x = 0.02 * (k - (n - 1) / 2)
        up = {"axis": "z", "angle": np.pi / 2}
        made.add_marker(f"block.c{k}", position=[x, 0, 0], orientation=up)
        made.add_marker(f"ground.c{k}", position=[x, -LEAF["length"], 0], orientation=up)
        made.add_body(f"leaf{k}", leaf(), position=[x, -LEAF["length"], 0], orientation=up)
        made.add_joint(f"foot{k}", "fixed", between=[f"ground.c{k}", f"leaf{k}.root"])
        made.add_joint(f"head{k}", "fixed", between=[f"leaf{k}.tip", f"block.c{k}"])
        made.add_sensor(f"F{k}", "reaction", joint=f"foot{k}", on="J", quantity="force",
                        axes="global")  # fmt: skip
    made.add_force("push", "force", at="block", value=[f"{PUSH}", 0, 0])
    made.add_sensor("block", "position", of="block")
    return made


LEAF = {"length": 0.1, "thickness": 5e-4, "width": 0.02, "E": 2.1e11, "density": 7800.0}
PUSH = 10.0


@cache
def leaf():
    """A leaf of steel: its weak direction is along the block's way."""
    return reduce(
        line(4, end=(LEAF["length"], 0, 0)), modes=0, interfaces={"root": "root", "tip": "tip"},
        material={"E": LEAF["E"], "nu": 0.3, "density": LEAF["density"]},
        sections={"all": rectangle(LEAF["thickness"], LEAF["width"])},
    )  # fmt: skip


def off_leaves(n=20):
    """One spring of n times 12 EI/l^3, with 13/35 of the leaves' mass: F/k (1 - cos wt)."""
    EI = LEAF["E"] * LEAF["width"] * LEAF["thickness"] ** 3 / 12
    k = n * 12 * EI / LEAF["length"] ** 3
    m = 5.0 + n * 13 / 35 * LEAF["density"] * LEAF["width"] * LEAF["thickness"] * LEAF["length"]

    def judge(run):
        way = PUSH / k * (1 - np.cos(np.sqrt(k / m) * run.time))
        return largest(run["block.x"] - way) / np.ptp(way)

    return judge


def three_cranks():
    """A plate on three cranks in a row, spatial joints: nine more equations than it needs."""
    made = Model("three cranks", gravity=[0, -G, 0])
    for k in range(3):
        made.add_body(f"crank{k}", mass=1, center=[0, 0.5, 0], inertia=[1 / 12, 1e-3, 1 / 12],
                      position=[k, 0, 0], angular_velocity=[0, 0, -1.0])  # fmt: skip
        made.add_marker(f"crank{k}.end", position=[0, 1, 0])
        made.add_marker(f"ground.pivot{k}", position=[k, 0, 0])
        made.add_joint(f"pivot{k}", "revolute", between=[f"ground.pivot{k}", f"crank{k}"], axis="z")
        made.add_sensor(f"F{k}", "reaction", joint=f"pivot{k}", on="J", quantity="force",
                        axes="global")  # fmt: skip
    made.add_body("plate", mass=2, center=[1, 0, 0], inertia=[1e-3, 1, 1], position=[0, 1, 0],
                  velocity=[1, 0, 0])  # fmt: skip
    for k in range(3):
        made.add_marker(f"plate.p{k}", position=[k, 0, 0])
        made.add_joint(f"pin{k}", "revolute", between=[f"crank{k}.end", f"plate.p{k}"], axis="z")
    made.add_sensor("end", "position", of="crank0.end")
    return made


def off_three_cranks(run):
    """(3/3 + 2) p'' = g (3/2 + 2) sin p; the pivots bear the mass times acceleration and weight.

    Their sum in the flat poses is that of the smooth motion, to a thousandth of the weight.
    """
    swing = solve_ivp(lambda _, y: [y[1], 3.5 / 3 * G * np.sin(y[0])], (0, run.time[-1]),
                      [0.0, 1.0], "DOP853", run.time, rtol=1e-12, atol=1e-12).y  # fmt: skip
    p, rate = swing
    turn = 3.5 / 3 * G * np.sin(p)
    ax = 3.5 * (np.cos(p) * turn - np.sin(p) * rate**2)
    ay = 3.5 * (-np.sin(p) * turn - np.cos(p) * rate**2)
    forces = [sum(run[f"F{k}.{c}"] for k in range(3)) for c in "xy"]
    gap = largest(forces[0] - ax, forces[1] - ay - 5 * G) / (5 * G)
    return max(largest(run["end.x"] - np.sin(p), run["end.y"] - np.cos(p)), gap)


def net(n=4, spin=3.0, frame=False):
    """Balls in a plane, n by n, a metre apart, joined by links along, across and one diagonal.

    Free, spun about the normal of the plane; or, with a frame, the outer ones fixed and its weight
    across, which no tension bears.
    """
    made = Model("net", gravity=[0, 0, -G] if frame else "none")
    middle = (n - 1) / 2
    for i in range(n):
        for j in range(n):
            x, y = i - middle, j - middle
            made.add_body(f"b{i}{j}", mass=1, inertia=[1e-2] * 3, position=[x, y, 0],
                          velocity=[0, 0, 0] if frame else [-spin * y, spin * x, 0.5],
                          angular_velocity=[0, 0, 0] if frame else [0, 0, spin])  # fmt: skip
            made.add_sensor(f"b{i}{j}", "position", of=f"b{i}{j}")
            if frame and (i in (0, n - 1) or j in (0, n - 1)):
                made.add_marker(f"ground.g{i}{j}", position=[x, y, 0])
                made.add_joint(f"g{i}{j}", "fixed", between=[f"ground.g{i}{j}", f"b{i}{j}"])
    for i in range(n):
        for j in range(n):
            for name, to in (("x", (i + 1, j)), ("y", (i, j + 1)), ("d", (i + 1, j + 1))):
                if max(to) < n:
                    ends = [f"b{i}{j}", f"b{to[0]}{to[1]}"]
                    made.add_joint(f"{name}{i}{j}", "distance", between=ends)
                    made.add_sensor(f"{name}{i}{j}", "reaction", joint=f"{name}{i}{j}", on="J",
                                    quantity="force", axes="global")  # fmt: skip
    return made


def off_net(run, n=4, spin=3.0):
    """It turns as one body; the links of each ball give its centripetal force, over 9 N.

    Those of least norm turn with it: the force of each link stays what it was.
    """
    off, middle, t = 0.0, (n - 1) / 2, run.time
    turn = np.exp(1j * spin * t)
    for i in range(n):
        for j in range(n):
            z = (i - middle + 1j * (j - middle)) * turn
            place = run[f"b{i}{j}.x"] + 1j * run[f"b{i}{j}.y"]
            off = max(off, largest(place - z, run[f"b{i}{j}.z"] - 0.5 * t))
            force = 0 * z
            for name, before, at in (("x", (i - 1, j), (i, j)), ("y", (i, j - 1), (i, j)),
                                     ("d", (i - 1, j - 1), (i, j))):  # fmt: skip
                for (a, b), sign in ((before, 1), (at, -1)):
                    far = max(a + (name != "y"), b + (name != "x"))
                    if min(a, b) >= 0 and far < n:
                        link = f"{name}{a}{b}"
                        force = force + sign * (run[f"{link}.x"] + 1j * run[f"{link}.y"])
            off = max(off, largest(force + spin**2 * z) / 9.0)
    for name in {one[:3] for one in run.channels() if one[0] in "xyd"}:
        pull = np.hypot(run[f"{name}.x"], run[f"{name}.y"])
        off = max(off, np.ptp(pull) / 9.0)
    return off


_REDUNDANT = "are redundant: the motion is unique"
CASES = {
    "Bricard's loop": Hard(
        "Six hinges: 30 equations for 30 coordinates, and yet it moves.",
        "Points of the IFToMM benchmark to 1e-4 m; told that reactions are not unique.",
        1e-4, bricard, off_bricard, RUN, ALL, warns="redundant: the motion is unique",
        slow=True, quick=("auto", "radau"),
    ),
    "a door on three hinges": Hard(
        "Two hinges too many: ten redundant equations.",
        "Swing of a physical pendulum to 1e-4 rad; the hinges bear together m (a - g), to 1e-4 of "
        "the weight; told that each alone is not unique.",
        1e-4, door, off_door, RUN, ALL, warns=_REDUNDANT,
        slow=True, quick=("auto", "generalized-alpha"),
    ),
    "a four-bar of spatial joints": Hard(
        "Three of 20 equations are redundant.",
        "The angles close the loop and the weight's work is the kinetic energy, to 1e-3.",
        1e-3, four_bar, off_four_bar, RUN, ALL, warns=_REDUNDANT,
        slow=True, quick=("auto", "radau", "coordinate-partitioning"),
    ),
    "a pin tilted by 1e-9 rad": Hard(
        "Redundant equations contradict each other, by what machines and round-off leave.",
        "As if it were exact, to 1e-3.",
        1e-3, lambda: four_bar(1e-9), off_four_bar, RUN, ALL, warns=_REDUNDANT,
        slow=True, quick=("auto", "coordinate-partitioning"),
    ),
    "a pin tilted by 1e-8 rad": Hard(
        "Too much for round-off, too little to lock it.",
        "Refused before the run, with the size and the cure.",
        0.0, lambda: four_bar(1e-8), run=RUN, methods=ALL, stops={"all": "make them exact"},
        slow=True, quick=("auto",),
    ),
    "a pin tilted by 1e-5 rad": Hard(
        "The tilt locks the four-bar, and its lever is 1e5.",
        "Refused before the run: locked, nearly free, and what to exchange.",
        0.0, lambda: four_bar(1e-5), run=RUN, methods=ALL, stops={"all": "it is nearly free"},
        slow=True, quick=("auto",),
    ),
    "a pin tilted by 0.01 rad": Hard(
        "Locked: nothing can move, with forces a thousand times the weight.",
        "It rests to 1e-9 rad, and says that it is locked, and by what.",
        1e-9, lambda: four_bar(1e-2), lambda run: largest(run["crank"], run["rocker"]), RUN, ALL,
        warns="the mechanism is locked",
        slow=True, quick=("auto", "radau", "baumgarte"),
    ),
    "twenty parallel leaves": Hard(
        "A block on 20 clamped beams: 114 equations too many, were they rigid.",
        "One spring of 20 times 12 EI/l3: way of the block to 1e-2 of it, by beams and their mass.",
        1e-2, leaf_guides, off_leaves(), {"duration": 0.1, "outputs": 40, "accuracy": 1e-4},
        {"auto": {}, "generalized-alpha": {"accuracy": None, "step": 2e-4}, "radau": {},
         "fixed radau": {"accuracy": None, "step": 1e-3}},
        slow=True,
    ),
    "a rank that changes on the way": Hard(
        "A plate on three cranks in a row: flat, twice a turn, two more equations are redundant.",
        "The pendulum of one freedom to 1e-3 m; sum of the pivots' forces to 1e-3 of the weight.",
        1e-3, three_cranks, off_three_cranks, {**RUN, "outputs": 39}, ALL,
        warns=_REDUNDANT,
        slow=True, quick=("auto", "generalized-alpha", "radau"),
    ),
    "a flat net that spins": Hard(
        "16 balls and 33 links in one plane: links pull at each other, and none has a say across.",
        "It turns as one body to 1e-4 m; each ball's links give its centripetal force to 1e-4, "
        "each with a force of its own that stays.",
        1e-4, net, off_net, {"duration": 1.0, "outputs": 10, "accuracy": 1e-6},
        {**ALL, "generalized-alpha": {"accuracy": None, "step": 5e-4}}, warns=_REDUNDANT,
        slow=True, quick=("auto", "radau"),
    ),
    "a taut net under its weight": Hard(
        "Flat in a frame of rigid links: no tension bears a load across.",
        "No run begins: the motions across are infinitesimal, by a self-stress of the links.",
        0.0, lambda: net(4, 0.0, True), run={"duration": 1.0, "outputs": 10, "accuracy": 1e-4},
        methods={"auto": {}, "generalized-alpha": {}, "explicit-rk": {}, "radau": {}},
        stops={"all": "4 free motions are infinitesimal"},
    ),
}  # fmt: skip
