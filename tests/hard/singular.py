"""Singular positions: parallelograms that lie flat, change points, stretched limits, gimbals."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from flexmb.model import Model
from tests.hard.case import Hard, largest

G = 9.81
FAST = {
    "auto": {},
    "generalized-alpha": {"accuracy": None, "step": 1e-3},
    "explicit-rk": {},
    "radau": {},
}


def parallelograms(n):
    """n parallelograms in a row that go through the flat position twice a turn."""
    made = Model("parallelograms", gravity=[0, -G, 0])
    J = 1 / 12  # slender rods, 1 kg and 1 m
    for k in range(n + 1):
        made.add_body(f"crank{k}", mass=1, center=[0, 0.5, 0], inertia=[J, 1e-3, J],
                      position=[k, 0, 0], angular_velocity=[0, 0, -1.0])  # fmt: skip
        made.add_marker(f"crank{k}.end", position=[0, 1, 0])
        made.add_marker(f"ground.pivot{k}", position=[k, 0, 0])
        made.add_joint(f"pivot{k}", "revolute", between=[f"ground.pivot{k}", f"crank{k}"], axis="z")
    for k in range(1, n + 1):
        made.add_body(f"rod{k}", mass=1, center=[0.5, 0, 0], inertia=[1e-3, J, J],
                      position=[k - 1, 1, 0], velocity=[1, 0, 0])  # fmt: skip
        made.add_marker(f"rod{k}.end", position=[1, 0, 0])
        made.add_joint(f"left{k}", "revolute", between=[f"crank{k - 1}.end", f"rod{k}"], axis="z")
        made.add_joint(f"right{k}", "revolute", between=[f"rod{k}.end", f"crank{k}.end"], axis="z")
    made.add_sensor("end", "position", of="crank0.end")
    return made


def off_parallelograms(n):
    """Distance from a pendulum of one freedom, in which all cranks turn alike.

    With n + 1 cranks and n rods: ((n + 1)/3 + n) φ'' = g ((n + 1)/2 + n) sin φ, φ from the top.
    """
    inertia, weight = (n + 1) / 3 + n, G * ((n + 1) / 2 + n)

    def judge(run):
        swing = solve_ivp(lambda _, y: [y[1], weight / inertia * np.sin(y[0])],
                          (0, run.time[-1]), [0.0, 1.0], "DOP853", run.time,
                          rtol=1e-12, atol=1e-12).y[0]  # fmt: skip
        return largest(run["end.x"] - np.sin(swing), run["end.y"] - np.cos(swing))

    return judge


def equal_slider_crank():
    """Crank and rod of one length: with the crank upright the slider may stop on its bearing."""
    made = Model("slider-crank, r = l", plane="xy")
    made.add_body("crank", mass=1, inertia=[1, 1, 0.1], angular_velocity=[0, 0, 5])
    made.add_marker("crank.pin", position=[0.3, 0, 0])
    made.add_body("rod", mass=1, center=[0.15, 0, 0], inertia=[1, 1, 0.02], position=[0.3, 0, 0],
                  angular_velocity=[0, 0, -5], velocity=[0, 1.5, 0])  # fmt: skip
    made.add_marker("rod.end", position=[0.3, 0, 0])
    made.add_body("slider", mass=1, inertia=[1, 1, 1], position=[0.6, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "revolute", between=["crank.pin", "rod"], axis="z")
    made.add_joint("wrist", "revolute", between=["rod.end", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_sensor("turn", "angle", joint="bearing")
    made.add_sensor("slider", "position", of="slider")
    return made


def off_cosine(run):
    """The slider is at 2 r cos φ, and the energy of the free motion stays."""
    kinetic = run.energy["kinetic"]
    return largest(run["slider.x"] - 0.6 * np.cos(run["turn"]), (kinetic / kinetic[0] - 1) * 0.6)


def stretched():
    """Two links whose end is pulled beyond their reach of 2 m, reached at t = 0.5 s."""
    made = Model("stretched", plane="xy")
    bend = np.arccos(0.75)
    made.add_body("one", mass=1, inertia=[1, 1, 1], orientation={"axis": "z", "angle": bend})
    made.add_marker("one.end", position=[1, 0, 0])
    made.add_body("two", mass=1, inertia=[1, 1, 1], position=[np.cos(bend), np.sin(bend), 0],
                  orientation={"axis": "z", "angle": -bend})  # fmt: skip
    made.add_marker("two.end", position=[1, 0, 0])
    made.add_joint("shoulder", "revolute", between=["ground", "one"], axis="z")
    made.add_joint("elbow", "revolute", between=["one.end", "two"], axis="z")
    made.add_driver("pull", between=["ground", "two.end"], distance="1.5 + t")
    return made


def universal_joint():
    """A shaft that turns through gimbals at 30 degrees, 100 turns a second."""
    made = Model("universal joint")
    tilt = np.pi / 6
    made.add_body("drive", mass=1, inertia=[1, 1, 1])
    made.add_body("out", mass=1, inertia=[1, 1, 1], orientation={"axis": "y", "angle": tilt})
    made.add_joint("first", "revolute", between=["ground", "drive"], axis="z")
    along, across = [np.sin(tilt), 0, np.cos(tilt)], [np.cos(tilt), 0, -np.sin(tilt)]
    made.add_joint("second", "cylindrical", between=["ground", "out"], axis=along)
    made.add_joint("cross", "universal", between=["drive", "out"], axis="y", second_axis=across)
    made.add_driver("motor", joint="first", angle="200*pi*t")
    made.add_sensor("turn", "angle", joint="second")
    return made


def off_cardan(run):
    """tan of the output is tan of the input times the cosine of the tilt, or over it.

    Wittenburg, Dynamics of Multibody Systems (2008); which of both depends on the axes at the
    start: the drive's pin lies in the plane of the shafts or across it.
    """
    drive, turned = 200 * np.pi * run.time, run["turn"]
    ways = []
    for a, b in ((np.cos(np.pi / 6), 1), (1, np.cos(np.pi / 6))):
        truth = np.arctan2(a * np.sin(drive), b * np.cos(drive))
        ways.append(largest(np.angle(np.exp(1j * (turned - truth)))))
    return min(ways)


CASES = {
    "two parallelograms through the horizontal": Hard(
        "The constraints lose rank twice a turn; the other branch begins there.",
        "Ten turns on the branch of the pendulum: 1e-3 m; a wrong branch is off by metres.",
        1e-3, lambda: parallelograms(2), off_parallelograms(2),
        {"duration": 10.0, "outputs": 400, "accuracy": 1e-5},
        {**FAST, "generalized-alpha": {"accuracy": None, "step": 2e-4}},
        stops={"radau": "singular"}, seconds=True, slow=True,
        quick=("auto", "generalized-alpha", "explicit-rk"),
    ),
    "forty parallelograms through the horizontal": Hard(
        "The rank drops by forty at once.",
        "Half a turn: 1e-3 m.",
        1e-3, lambda: parallelograms(40), off_parallelograms(40),
        {"duration": 1.0, "outputs": 20, "accuracy": 1e-4},
        {**FAST, "generalized-alpha": {"accuracy": None, "step": 2e-4, "newton_tolerance": 1e-6}},
        stops={"radau": "singular", "generalized-alpha": "singular"}, slow=True,
    ),
    "a slider-crank of equal lengths": Hard(
        "With the crank upright the slider can stay on its bearing while crank and rod turn on.",
        "The momentum carries it on: place and energy to 1e-3 of the stroke over eight turns.",
        0.6e-3, equal_slider_crank, off_cosine,
        {"duration": 10.0, "outputs": 400, "accuracy": 1e-5}, FAST,
    ),
    "two links pulled beyond their reach": Hard(
        "At the stretched pose no motion follows the driver.",
        "It stops there, with the driver or the pose in its sentence.",
        0.0, stretched, run={"duration": 1.0, "outputs": 50, "accuracy": 1e-4}, methods=FAST,
        stops={"all": "t = 0."},
    ),
    "a universal joint at full speed": Hard(
        "Gimbal angles turn a thousand times.",
        "The output follows the formula of Cardan to 1e-6 rad: the motion is prescribed.",
        1e-6, universal_joint, off_cardan,
        {"duration": 1.0, "outputs": 173, "accuracy": 1e-6},
        {**FAST, "generalized-alpha": {"accuracy": None, "step": 1e-4}},
    ),
}  # fmt: skip
