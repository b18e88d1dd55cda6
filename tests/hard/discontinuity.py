"""Discontinuity: impacts, stops, friction that holds, steps and switches of forces."""

from __future__ import annotations

from functools import cache

import numpy as np
from flexiblescenes import rod

import flexmb
from flexmb.model import Model
from tests.accuracyscenes import SCENES, moved
from tests.accuracyscenes.friction import FRICTION
from tests.hard.case import METHODS, Hard, largest

G = 9.81
SUCCESS = {
    "auto": {}, "generalized-alpha": {"accuracy": None, "step": 1e-4}, "explicit-rk": {},
    "radau": {},
}  # fmt: skip


def off_truth(name, size=1.0, away=0.0):
    """Largest departure from the known motion of a scene, over it."""
    truth = (SCENES | FRICTION)[name].truth

    def judge(run):
        return max(
            largest((run[c] - away) / size - v) / np.ptp(v) for c, v in truth(run.time).items()
        )

    return judge


def falling_ball():
    made = Model("ball", gravity=[0, 0, -G])
    made.add_body("ball", mass=1, inertia=[0.004] * 3, position=[0, 0, 0.6])
    made.add_force("floor", "contact", between=["ball", "ground"], stiffness=1e8, restitution=0.5,
                   shapes=[{"type": "sphere", "radius": 0.1}, {"type": "plane"}])  # fmt: skip
    made.add_sensor("ball", "position", of="ball")
    return made


def on_a_slope(tilt):
    """A block on a guide that rises by an angle, with dry friction of 0.3."""
    made = Model("slope", gravity=[-G * np.sin(tilt), -G * np.cos(tilt), 0])
    made.add_body("block", mass=2, inertia=[1, 1, 1])
    made.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
    made.add_force("rub", "joint-friction", joint="guide", static=0.3, dynamic=0.3,
                   stiffness=1e6, damping=1e3)  # fmt: skip
    made.add_sensor("way", "stroke", joint="guide")
    return made


def pushed():
    """A mass on a guide, pushed with 3 N for 0.1 s and pulled back by a switch of the sign."""
    made = Model("pushed")
    made.add_body("m", mass=1, inertia=[1, 1, 1])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_force("push", "force", at="m", value=["3*sign(0.1 - t)", 0, 0])
    made.add_sensor("m", "position", of="m")
    return made


def off_push(run):
    t = run.time
    late = 0.015 + 0.3 * (t - 0.1) - 1.5 * (t - 0.1) ** 2
    return largest(run["m.x"] - np.where(t < 0.1, 1.5 * t**2, late))


def against_its_stop(size=1.0):
    """A mass that touches its stop of 1e4 N/m at rest, and is pushed against it with 5 N."""
    made = Model("pressed")
    made.add_body("m", mass=1, inertia=[size**2] * 3)
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_force("stop", "translational-stop", joint="guide", lower=-size, upper=0,
                   stiffness=1e4)  # fmt: skip
    made.add_force("push", "force", at="m", value=[5 * size, 0, 0])
    made.add_sensor("m", "position", of="m")
    return made


def off_stop(run):
    """F/k (1 - cos wt): it never leaves the stop."""
    return largest(run["m.x"] - 5e-4 * (1 - np.cos(100 * run.time))) / 1e-3


CHAIN, GAP, HARD, SPEED = 4, 0.05, 1e5, 1.0


def chain():
    """Four balls of 1 kg on a rail, 50 mm apart; the first one is thrown at the others."""
    made = Model("chain")
    for k in range(CHAIN):
        x = (0.1 + GAP) * k
        made.add_marker(f"ground.g{k}", position=[x, 0, 0])
        made.add_body(f"b{k}", mass=1, inertia=[0.001] * 3, position=[x, 0, 0],
                      velocity=[SPEED * (k == 0), 0, 0])  # fmt: skip
        made.add_joint(f"rail{k}", "prismatic", between=[f"ground.g{k}", f"b{k}"], axis="x")
        made.add_sensor(f"x{k}", "stroke", joint=f"rail{k}")
        if k:
            balls = [{"type": "sphere", "radius": 0.05}] * 2
            made.add_force(f"hit{k}", "contact", between=[f"b{k - 1}", f"b{k}"], exponent=1,
                           stiffness=HARD, shapes=balls)  # fmt: skip
    return made


def off_chain(run):
    """Each blow is half a swing of two masses on a spring; then the next one flies on alone."""
    w = np.sqrt(2 * HARD)
    begin, off = GAP / SPEED, 0.0
    x = [SPEED * np.minimum(run.time, begin)] + [np.zeros(len(run.time)) for _ in range(CHAIN - 1)]
    for k in range(CHAIN - 1):
        late = np.clip(run.time - begin, 0.0, np.pi / w)
        swing = SPEED * np.sin(w * late) / w
        x[k] = x[k] + (SPEED * late + swing) / 2
        x[k + 1] = x[k + 1] + (SPEED * late - swing) / 2
        begin += np.pi / w
        free = GAP / SPEED - np.pi / w / 2 if k < CHAIN - 2 else np.inf
        x[k + 1] = x[k + 1] + SPEED * np.clip(run.time - begin, 0.0, free)
        begin += free
        off = max(off, largest(run[f"x{k}"] - x[k]))
    return max(off, largest(run[f"x{CHAIN - 1}"] - x[-1]))


def pulled_by_a_leaf():
    """A leaf spring of 0.4 m on a cart of 0.1 m/s pulls a block that rubs on its guide."""
    made = Model("leaf", gravity=[0, 0, -G])
    upright = {"axis": "z", "angle": np.pi / 2}
    made.add_body("cart", mass=1, inertia=[0.01] * 3)
    made.add_body("leaf", rod(0.004, 0.4), orientation=upright)
    made.add_body("block", mass=1, inertia=[0.01] * 3, position=[0, 0.4, 0])
    made.add_marker("cart.top", orientation=upright)
    made.add_marker("ground.guide", position=[0, 0.4, 0])
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    made.add_driver("motor", joint="rail", stroke="0.1*t")
    made.add_joint("clamp", "fixed", between=["cart.top", "leaf.root"])
    made.add_joint("guide", "prismatic", between=["ground.guide", "block"], axis="x")
    made.add_joint("pull", "in-plane", between=["block", "leaf.tip"], axis="x")
    made.add_force("rub", "joint-friction", joint="guide", static=0.3, dynamic=0.2,
                   stribeck_speed=0.05, stiffness=1e5, damping=300)  # fmt: skip
    made.add_sensor("way", "stroke", joint="guide")
    return made


@cache
def leaf_by_order_8():
    made = pulled_by_a_leaf()
    made.set_dynamics(duration=1.0, outputs=100, method="explicit-rk", accuracy=1e-8, verify=False)
    return flexmb.simulate(made)["way"]


def off_leaf(run):
    return largest(run["way"] - leaf_by_order_8()) / 0.1


ALL = SUCCESS | {
    f"fixed {method}": SUCCESS["generalized-alpha"] for method in ("explicit-rk", "radau")
}


def rubs(name, hard, **fields):
    """A case of stick and slip, beside scipy from event to event."""
    scene = FRICTION[name]
    fields = {
        "make": lambda: scene.make(1.0),
        "judge": off_truth(name),
        "methods": SUCCESS,
        **fields,
    }
    return Hard(
        hard, "scipy's motion of its law, from event to event: 1e-3, ten times the accuracy.", 1e-3,
        run={"duration": scene.duration, "outputs": 200, "accuracy": 1e-4}, **fields,
    )  # fmt: skip


BRISTLES = "block on stiffly damped bristles"

CASES = {
    "a block that swings until it sticks": rubs(
        BRISTLES, "Bristles of 4e5 N/m and 1000 N s/m hold it within 1 ms, at each turn for 0.5 ms."
    ),
    "the same 1 km away": rubs(
        BRISTLES, "Round-off is 1e-13 m, and it sticks within 7e-6 m.",
        make=lambda: moved(FRICTION[BRISTLES].make(1.0)), judge=off_truth(BRISTLES, away=1000.0),
    ),
    "the same of micrometres": rubs(
        BRISTLES, "It sticks within 7e-12 m.", judge=off_truth(BRISTLES, 1e-6),
        make=lambda: FRICTION[BRISTLES].make(1e-6),
    ),
    "a block on points that sticks": rubs(
        "block on points", "Contacts of 1e6 N/m, four bristles with one load each."
    ),
    "a belt that carries a block": rubs(
        "block on a belt", "It sticks, slips and sticks again, by Stribeck's curve."
    ),
    "a belt to and fro": rubs(
        "block on a belt to and fro", "Friction drives, and changes its way 2.5 times a second."
    ),
    "a leaf spring that pulls a block": Hard(
        "A flexible drive stores what friction lets go: modes of 1e4 1/s beside stick and slip.",
        "Order 8 at 1e-8 to 1e-3 of the way, ten times the accuracy.", 1e-3, pulled_by_a_leaf,
        off_leaf, {"duration": 1.0, "outputs": 100, "accuracy": 1e-4}, ALL, slow=True,
    ),
    "a mass pressed against its stop": Hard(
        "It begins where the stop does, at rest, with no step before it touches.",
        "F/k (1 - cos wt) to 1e-3 of the way.", 1e-3, against_its_stop, off_stop,
        {"duration": 0.5, "outputs": 100, "accuracy": 1e-4}, ALL,
    ),
    "four balls in a row": Hard(
        "Each blow of 7 ms sends the next ball; those behind it stay where they are.",
        "Half a swing for each blow: 1e-4 m, by fixed steps too.", 1e-4, chain, off_chain,
        {"duration": 0.3, "outputs": 100, "accuracy": 1e-4}, ALL,
    ),
    "a ball that bounces without losses": Hard(
        "Impacts of 10 ms between flights of 0.6 s.",
        "Five bounces follow the closed form to 1e-3 of the height: ten times the accuracy.",
        1e-3, lambda: SCENES["bouncing ball"].make(1.0), off_truth("bouncing ball"),
        {"duration": 3.0, "outputs": 300, "accuracy": 1e-4}, SUCCESS,
    ),
    "steps too long for an impact": Hard(
        "A step of 10 ms crosses the depth of an impact of 1 ms.",
        "The run ends, and says that energy appeared in its steps.",
        np.inf, falling_ball, run={"duration": 0.6, "outputs": 60, "step": 1e-2},
        methods={method: {} for method in METHODS}, warns="energy balance is off",
    ),
    "a mass between stops": Hard(
        "Stops of 1e4 N/m, met again and again.",
        "The closed form to 1e-3 of the way.",
        1e-3, lambda: SCENES["mass between stops"].make(1.0), off_truth("mass between stops"),
        {"duration": 2.0, "outputs": 300, "accuracy": 1e-4}, SUCCESS,
    ),
    "a block that friction holds on a slope": Hard(
        "Its weight along the slope is two thirds of what friction can hold.",
        "Once the bristles bear it, it creeps by less than 1e-9 m in nine seconds.",
        1e-9, lambda: on_a_slope(np.arctan(0.2)),
        lambda run: np.ptp(run["way"][run.time >= 1.0]),
        {"duration": 10.0, "outputs": 100, "accuracy": 1e-4}, SUCCESS,
    ),
    "a force that changes its sign": Hard(
        "The force jumps from 3 N to -3 N at t = 0.1 s.",
        "The parabolas to 1e-6 m in controlled steps, to the order in fixed ones.",
        1e-6, pushed, off_push, {"duration": 0.4, "outputs": 80, "accuracy": 1e-6}, SUCCESS,
    ),
}  # fmt: skip
