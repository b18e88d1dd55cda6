"""Random mechanisms: what a run tells of its error, beside a far finer run by another method.

`PYTHONPATH=tests python -m tests.hard.random_mechanisms --begin 0 --count 50 --method auto radau`
prints one line for each run that misses twice what was asked for without a word, or tells less than
a third or more than three times an error that is near it; at the end how many there were.

Up to five bodies of any inertia in a tree of any joints, of millimetres to hundreds of metres, at
the origin or a kilometre away; drivers, torques of time, by tables and by a controller with limits,
soft and stiff springs, dampers and bushings.
"""

from __future__ import annotations

import argparse
import signal
from collections import Counter
from dataclasses import dataclass

import numpy as np
from accuracyscenes.judging import METHODS, judged
from truthkit import run

from flexmb.errors import FlexmbError
from flexmb.model import Model

ASKED = (1e-3, 1e-5, 1e-7)
_JOINTS = (
    ("revolute", {"axis": "z"}), ("revolute", {"axis": "x"}), ("spherical", {}),
    ("universal", {"axis": "x", "second_axis": "y"}), ("prismatic", {"axis": "x"}),
    ("cylindrical", {"axis": "z"}), ("planar", {"axis": "z"}), (None, {}),
)  # fmt: skip
_STILL = 1e-9  # of where a sensor is: what moves less is at rest
_OUTPUTS, _FINE, _BESIDE = 60, 1e-10, 1e-8
_SURE = 0.05  # of an error that is judged, that the finer runs may have themselves


def mechanism(seed):
    """A model, and how long it is run [s]."""
    draw = np.random.default_rng(seed)
    size = float(10.0 ** draw.choice([-3, 0, 0, 0, 2]))
    away = draw.choice([0, 0, 1.0]) * 1000.0 * draw.normal(size=3)
    gravity = float(draw.choice([0, 9.81])) * size
    model = Model(f"mechanism {seed}", gravity=[0, -gravity, 0] if gravity else "none")
    model.add_marker("ground.base", position=away.tolist())
    tips = []
    for k in range(int(draw.integers(1, 6))):
        parent = int(draw.integers(-1, k)) if k else -1
        at, arm = (tips[parent] if parent >= 0 else away), size * draw.normal(size=3) * 0.5
        joint, axes = _JOINTS[int(draw.integers(len(_JOINTS)))]
        joint = joint or ("spherical" if gravity else None)  # nothing falls
        mass, thrown = float(10.0 ** draw.uniform(-1, 1)), draw.choice([0, 1, 3])
        spin = (thrown * draw.normal(size=3)).tolist()
        model.add_body(
            f"b{k}", mass=mass, center=(0.5 * arm).tolist(), position=at.tolist(),
            inertia=(mass * size**2 * _inertia(draw)).tolist(),
            **({"angular_velocity": spin} if joint in (None, "spherical") else {}),
        )  # fmt: skip
        model.add_marker(f"b{k}.tip", position=arm.tolist())
        model.add_sensor(f"tip{k}", "position", of=f"b{k}.tip")
        tips.append(at + arm)
        if joint:
            between = [f"b{parent}.tip" if parent >= 0 else "ground.base", f"b{k}"]
            model.add_joint(f"j{k}", joint, between=between, **axes)
        if joint == "revolute":
            _move(model, draw, k, mass * size**2)
    for k in range(int(draw.integers(0, 4))):
        _tie(model, draw, k, tips, size, away)
    return model, float(draw.choice([1.0, 3.0, 10.0]))


def _inertia(draw):
    """(3, 3) of some mass about the centre, of no principal axes in particular."""
    root = draw.normal(size=(3, 3))
    spread = root @ root.T + 0.3 * np.eye(3)
    scale = 0.05 * 10.0 ** draw.uniform(-1, 1)
    return scale * (np.trace(spread) * np.eye(3) - spread)


def _move(model, draw, k, inertia):
    """What turns a revolute joint, if anything: a driver, or a torque of some kind."""
    joint, torque = f"j{k}", {}
    model.add_sensor(f"angle{k}", "angle", joint=joint)
    model.add_sensor(f"rate{k}", "angle", joint=joint, derivative=1)
    size, pace, loss = (float(draw.uniform(*of)) for of in ((1, 20), (0.5, 6), (0, 0.5)))
    kind = int(draw.integers(0, 6))
    if kind == 0:
        model.add_driver(f"d{k}", joint=joint, angle=f"{size / 10}*sin({pace}*t)")
    elif kind == 1:
        torque["value"] = f"{inertia * size!r}*sin({pace}*t) - {inertia * loss!r}*rate{k}"
    elif kind == 2:
        torque["stiffness"] = inertia * float(10 ** draw.uniform(0, 4))
        torque["damping"] = inertia * float(10 ** draw.uniform(-2, 1))
    elif kind == 3:
        t = [0.0, *np.sort(draw.uniform(0.1, 9.9, 6)), 10.5]
        points = np.stack([t, 5 * inertia * draw.normal(size=8)], axis=1).tolist()
        form = str(draw.choice(["table", "akima", "spline"]))
        torque["value"] = {"type": form, "points": points}
    elif kind == 4:
        law = f"30*(sin(2*t) - angle{k}) - 5*rate{k}"
        torque["value"] = f"{inertia!r}*max(-4, min(4, {law}))"
    if torque:
        model.add_force(f"t{k}", "rotational-spring-damper", joint=joint, **torque)


def _tie(model, draw, k, tips, size, away):
    """A spring or a bushing between a tip and another, or ground."""
    i, j = int(draw.integers(len(tips))), int(draw.integers(-1, len(tips)))
    if i == j:
        return
    if j < 0:
        model.add_marker(f"ground.s{k}", position=(away + size * draw.normal(size=3)).tolist())
    ends = [f"b{i}.tip", f"b{j}.tip" if j >= 0 else f"ground.s{k}"]
    stiffness = float(10 ** draw.uniform(0, 5))
    if j < 0 or draw.random() < 0.7:
        model.add_force(
            f"s{k}", "spring-damper", between=ends, stiffness=stiffness,
            damping=stiffness * float(10 ** draw.uniform(-4, -1)),
            free_length=size * float(draw.uniform(0.2, 1.5)),
        )  # fmt: skip
    else:
        model.add_force(
            f"s{k}", "bushing", between=ends, stiffness=stiffness, damping=0.01 * stiffness,
            rotational_stiffness=stiffness * size**2,
        )  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """One run beside the finer one; errors over the peak-to-peak of their sensor."""

    asked: float
    achieved: float
    told: float
    said: bool  # that what was asked for was not reached
    steps: int

    @property
    def words(self):
        """What is wrong with it."""
        if self.achieved > 2 * self.asked and not self.said:
            return "MISSED"
        if max(self.achieved, self.told) > 0.2 * self.asked:
            return "SMALL" if self.told < self.achieved / 3 else (
                "LARGE" if self.told > 3 * self.achieved else ""
            )  # fmt: skip
        return ""


def verdicts(seed, method):
    """One for each of `ASKED`; none where two fine runs differ, as chaotic motions do.

    The fine runs are by different methods, where the scene allows both.
    """
    model, duration = mechanism(seed)
    knobs = {"duration": duration, "outputs": _OUTPUTS}
    fine = run(model, accuracy=_FINE, **knobs)
    other = "radau" if fine.statistics["method"] != "radau" else "explicit-rk"
    beside = run(model, accuracy=_BESIDE, method=other, **knobs)
    places = [c for c in model.channels() if c.startswith(("tip", "angle"))]
    moving = [c for c in places if np.ptp(fine[c]) > _STILL * np.abs(fine[c]).max()]
    truth = {c: fine[c] for c in moving}
    unsure = max((np.abs(fine[c] - beside[c]).max() / np.ptp(fine[c]) for c in moving), default=0.0)
    found = []
    for asked in ASKED if moving else ():
        if unsure > _SURE * asked:
            continue
        one = judged(
            mechanism(seed)[0], lambda t: truth, accuracy=asked, **METHODS[method], **knobs
        )
        assert not one.message, (seed, asked, one.message)
        said = any("was asked for" in note for note in one.notes)
        found.append(Verdict(asked, one.achieved, one.told, said, one.steps))
    return found


def _interrupt(*_):
    raise TimeoutError


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--begin", type=int, default=0)
    options.add_argument("--count", type=int, default=50)
    options.add_argument("--method", nargs="+", default=["auto"], choices=METHODS)
    options.add_argument("--seconds", type=int, default=60, help="for one mechanism")
    told = options.parse_args()
    signal.signal(signal.SIGALRM, _interrupt)
    count = Counter()
    for seed in range(told.begin, told.begin + told.count):
        for method in told.method:
            signal.alarm(told.seconds)
            try:
                found = verdicts(seed, method)
            except (FlexmbError, AssertionError, TimeoutError) as error:
                count["not judged"] += 1
                print(f"{seed:6} {method:18} {type(error).__name__} {error}"[:200], flush=True)
                continue
            finally:
                signal.alarm(0)
            count["runs"] += len(found)
            for one in found:
                count[one.words] += 1
                if one.words:
                    print(f"{seed:6} {method:18}{one.asked:7.0e}: {one.achieved / one.asked:9.2g} "
                          f"times, told {one.told / one.asked:9.2g}, {one.steps} steps, "
                          f"{one.words}", flush=True)  # fmt: skip
    print(", ".join(f"{count[word]} {word}" for word in ("runs", "MISSED", "SMALL", "LARGE",
                                                         "not judged")))  # fmt: skip


if __name__ == "__main__":
    main()
