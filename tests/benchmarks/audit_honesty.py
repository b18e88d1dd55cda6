"""How honest the audit is: what it estimates against what the complete model really does.

    python -m tests.benchmarks.audit_honesty [--random 20] [--cases] [--scenes NAME ...]

Each scene runs complete (dynamic modes, full inertia coupling, geometric stiffening), with rigid
bodies, without coupling and stiffening, and with ``effects = "auto"``. Estimated and true are the
largest change at any sensor over its peak-to-peak; the estimate is the sum over the bodies and the
effects that are left out. A change of the whole motion and more is compared as 1; what is below
1e-4 in both is within the accuracy of the runs and not compared.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import tomllib
import warnings
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.folders import writable_folder
from flexmb.model import Model
from flexmb.model.scenes.effects import with_words
from flexmb.model.scenes.study import override
from flexmb.results import Result
from flexmb.workflow.effect import MODES, STIFFENING
from flexmb.workflow.effect_estimates import Estimates
from flexmb.workflow.effect_selection import run_with_selected_effects
from flexmb.workflow.neighbours import ModelVariants
from flexmb.workflow.run import run_single

ROOT = Path(__file__).parents[2]
BUDGET = 0.01
FLOOR = 1e-4  # of runs of accuracy 1e-5
COMPLETE = {
    "deformation": "dynamic", "inertia_coupling": "full", "geometric_stiffening": "full",
}  # fmt: skip
LEVELS = {
    "rigid": {"deformation": "rigid", "geometric_stiffening": "none"},
    "constant": {
        "deformation": "dynamic", "inertia_coupling": "constant", "geometric_stiffening": "none",
    },
}  # fmt: skip
SPEEDS = (0.3, 1.0, 2.0)
_BOUNDS = ("deflection", "rotation", "speed", "inertia_loads", "truncation", "load_factor")


def scaled_times(scene: dict, f: float) -> dict[str, object]:
    """The excavator's drivers and loads, f times as fast."""
    changes = {"dynamics.duration": 11 / f}
    for name, driver in scene["drivers"].items():
        word = "angle" if "angle" in driver else "distance"
        changes[f"drivers.{name}.{word}"] = driver[word].replace("(t,", f"({f}*t,")
    for name, force in scene["forces"].items():
        changes[f"forces.{name}.value"] = [
            part.replace("(t,", f"({f}*t,") if isinstance(part, str) else part
            for part in force["value"]
        ]
    return changes


# What makes a case f times as fast, or its load f times as large; with few outputs, to be short.
CASES = {
    "slider_crank/scene": lambda s, f: {"speed": 50 * np.pi * f, "dynamics.outputs": 300},
    "slider_crank_speeds/medium": lambda s, f: {"speed": 200 * f},
    "flexible_four_bar/scene": lambda s, f: {"speed": 45 * f, "dynamics.outputs": 600},
    "rotating_beam_spin_up/scene": lambda s, f: {"speed": 6 * f, "dynamics.outputs": 300},
    "rotating_beam_frequencies/scene": lambda s, f: {"eta": 5 * f},
    "rotating_plate/scene": lambda s, f: {"eta": 5 * f},
    "wheel/scene": lambda s, f: {"turns": 2 * f, "dynamics.outputs": 100},
    "tapered_box/scene": lambda s, f: {"force": 30e3 * f, "dynamics.outputs": 100},
    "tuning_fork/scene": lambda s, f: {"force": 20 * f},
    "cantilever/scene": lambda s, f: {"gravity": [0, 0, -9.81 * f]},
    "flexible_manipulator/scene": lambda s, f: {"T": 1 / f, "dynamics.outputs": 300},
    "spacecraft_panels/scene": lambda s, f: {"T": 6 / f, "dynamics.duration": 10 / f},
    "spinning_disc/scene": lambda s, f: {"speed": 300 * f, "dynamics.outputs": 100},
    "hub_beam/scene": lambda s, f: {"T": 15 / f, "dynamics.outputs": 200},
    "misaligned_four_bar/scene": lambda s, f: {"speed": 0.6 * f, "dynamics.outputs": 200},
    "excavator/flexible": lambda s, f: {**scaled_times(s, f), "dynamics.outputs": 275},
    "test_set_crank/scene": lambda s, f: {"speed": 150 * f},
}
# Cases with flexible bodies that are not compared, and why.
LEFT_OUT = {
    "bracket": "nothing moves",
    "nafems_plates": "nothing moves",
    "supported_plate": "nothing moves",
    "elliptic_plate": "nothing moves",
    "slider_crank_speeds/slow": "slider_crank_speeds/medium at another speed",
    "slider_crank_speeds/scene": "slider_crank_speeds/medium at another speed",
    "rotating_beam_spin_up/zeroth_order": "the case beside a model that is wrong on purpose",
}
STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7850.0}
ALUMINIUM = {"E": 7.0e10, "nu": 0.33, "density": 2700.0}


def random_model(seed: int) -> Model:
    """A crank with a rod, an arm with a payload, a double pendulum or a four-bar, of slender bars.

    Lengths, sections, materials and speeds vary; the speed is 0.02 to 0.4 of the first pinned
    frequency of the longest bar.
    """
    rng = np.random.default_rng(seed)
    kind = ("crank", "arm", "pendulum", "four-bar")[seed % 4]
    L, slender = 10 ** rng.uniform(-1.5, 0.5), 10 ** rng.uniform(-2.3, -1.5)
    material = STEEL if rng.random() < 0.5 else ALUMINIUM
    omega = np.pi**2 * np.sqrt(material["E"] * slender**2 / (12 * material["density"])) / L
    speed = omega * 10 ** rng.uniform(-1.7, -0.4)
    mass = material["density"] * L * (slender * L) ** 2
    model = Model(f"{kind} {seed}")

    def bar(name: str, length: float, **place: object) -> None:
        section = {"type": "rectangle", "y": slender * L, "z": slender * L}
        model.add_body(
            name, mesh={"type": "beam", "length": length, "divisions": 10}, material=material,
            sections={"all": section}, interfaces={"root": "start", "tip": "end"}, modes=3,
            stress="none", **place,
        )  # fmt: skip

    def block(name: str, share: float, **place: object) -> None:
        m = share * mass
        model.add_body(name, mass=m, inertia=[m * L * L / 100] * 3, **place)

    if kind == "crank":
        r = rng.uniform(0.15, 0.4) * L
        block("crank", 1.0)
        model.add_marker("crank.pin", position=[r, 0, 0])
        bar("rod", L, position=[r, 0, 0])
        block("slider", rng.uniform(0.2, 2.0), position=[r + L, 0, 0])
        model.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
        model.add_joint("pin", "spherical", between=["crank.pin", "rod.root"])
        model.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
        model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
        model.add_driver("motor", joint="bearing", angle=f"{speed}*t")
        model.add_sensor("slider", "position", of="slider")
        model.add_marker("rod.middle", position=[L / 2, 0, 0])
        model.add_sensor("middle", "position", of="rod.middle")
        turns = 2.0
    elif kind == "arm":
        bar("arm", L)
        block("load", rng.uniform(0.1, 2.0), position=[L, 0, 0])
        model.add_joint("hub", "revolute", between=["ground", "arm.root"], axis="z")
        model.add_joint("grip", "fixed", between=["arm.tip", "load"])
        turn = {"type": "step", "t1": 2 * np.pi / speed, "y1": float(rng.uniform(0.5, 2.5))}
        model.add_driver("motor", joint="hub", angle=turn)
        model.add_sensor("load", "position", of="load")
        turns = 1.5
    elif kind == "pendulum":
        model.set_gravity([0, -speed * speed * L * rng.uniform(0.3, 1.0), 0])
        bar("upper", L)
        bar("lower", 0.7 * L, position=[L, 0, 0])
        model.add_joint("hinge", "revolute", between=["ground", "upper.root"], axis="z")
        model.add_joint("elbow", "revolute", between=["upper.tip", "lower.root"], axis="z")
        model.add_sensor("end", "position", of="lower.tip")
        model.add_sensor("elbow", "position", of="upper.tip")
        turns = 0.8
    else:
        a, b, c = 0.25 * L, L, 0.7 * L
        block("crank", 1.0, center=[0, a / 2, 0])
        model.add_marker("crank.pin", position=[0, a, 0])
        bar("coupler", b, position=[0, a, 0])
        model.add_marker("ground.right", position=[b, a - c, 0])
        block("rocker", 1.0, center=[0, c / 2, 0], position=[b, a - c, 0])
        model.add_marker("rocker.pin", position=[0, c, 0])
        model.add_joint("left", "revolute", between=["ground", "crank"], axis="z")
        model.add_joint("crank_pin", "spherical", between=["crank.pin", "coupler.root"])
        model.add_joint("rocker_pin", "revolute", between=["coupler.tip", "rocker.pin"], axis="z")
        model.add_joint("right", "cylindrical", between=["ground.right", "rocker"], axis="z")
        model.add_driver("motor", joint="left", angle=f"{speed}*t")
        model.add_sensor("pin", "position", of="rocker.pin")
        model.add_marker("coupler.middle", position=[b / 2, 0, 0])
        model.add_sensor("middle", "position", of="coupler.middle")
        turns = 1.5
    start = "quasi-static" if rng.random() < 0.5 and kind != "arm" else "undeformed"
    model.set_dynamics(
        duration=turns * 2 * np.pi / speed, outputs=300, accuracy=1e-5, start=start, verify=False
    )
    return model


def case_models(name: str, speeds: Sequence[float] = SPEEDS) -> list[tuple[str, Model]]:
    """A case of the repository at three speeds or loads."""
    path = ROOT / "cases" / f"{name}.toml"
    scene, models = tomllib.loads(path.read_text()), []
    for word in ("check", "view", "study"):
        scene.pop(word, None)
    for factor in speeds:
        changes = {"dynamics.accuracy": 1e-5, "dynamics.verify": False}
        changed, problems = override(scene, {**changes, **CASES[name](scene, factor)})
        assert not problems, problems
        model = Model.from_scene_dict(changed, path.parent)
        models.append((f"{name.removesuffix('/scene')} x {factor:g}", model))
    return models


def largest_change(run: Result, other: Result) -> float:
    """Largest difference at any sensor over its peak-to-peak."""
    sizes, changes, owners = defaultdict(float), defaultdict(float), {}
    units: dict[str, float] = defaultdict(float)
    for channel in run.channels():
        sensor = channel.split(".")[0]
        owners[sensor] = run.unit(channel)
        size = max(np.ptp(run[channel]), np.ptp(other[channel]))
        sizes[sensor] = max(sizes[sensor], size)
        units[run.unit(channel)] = max(units[run.unit(channel)], size)
        gap = np.abs(run[channel] - other[channel]).max()
        changes[sensor] = max(changes[sensor], gap)
    return max(
        (changes[k] / sizes[k] for k in sizes if sizes[k] > 1e-7 * units[owners[k]]), default=0.0
    )


def estimate(run: Result) -> float:
    """Sum of the estimated contributions of what a run leaves out, at the worst sensor; NaN where
    the audit has none."""
    estimates, sums = Estimates(ModelVariants.of(run, 600)), defaultdict(float)
    for effect in estimates.of.effects():
        if not effect.on and effect.name not in (MODES, "vibration"):
            if effect.why and effect.name == STIFFENING:  # the complete model has no data for it
                continue
            if effect.why:  # the audit says: not known
                return np.nan
            for one in estimates.estimate(effect)[0]:
                sums[one.sensor] += one.share
    return max(sums.values(), default=0.0)


def study(name: str, model: Model, folder: Path) -> list[tuple[str, str, float, float]]:
    """Rows of scene, level, estimate and truth; of the selection the truth alone."""
    flexible = [k for k, spec in model.bodies.items() if spec.flexible]

    def run(words: dict[str, str], label: str) -> Result:
        place = writable_folder(folder / label)
        lacking = {**words, "geometric_stiffening": "none"}  # a body file has what it has
        made = with_words(model, {
            k: lacking if hasattr(model.bodies[k], "flexbody") else words for k in flexible
        })  # fmt: skip
        made.set_validity(**dict.fromkeys(_BOUNDS, "any"))  # models are compared, right or not
        return Result(run_single(made, place, pictures=False).result)

    rows = []
    complete = run(COMPLETE, "complete")
    for level, words in LEVELS.items():
        try:
            made = run(words, level)
            rows.append((name, level, estimate(made), largest_change(made, complete)))
        except FlexmbError as error:
            print(f"{name} {level}: {str(error).splitlines()[0]}", flush=True)
    model = with_words(model, {})
    model.bodies = {
        k: _unstated(spec) if spec.flexible else spec for k, spec in model.bodies.items()
    }
    model.set_effects(choice="auto", budget=BUDGET)
    model.set_validity(**dict.fromkeys(_BOUNDS, "any"))
    try:
        report = run_with_selected_effects(model, writable_folder(folder / "auto"), pictures=False)
        rows.append((name, "auto", np.nan, largest_change(Result(report.result), complete)))
    except FlexmbError as error:
        print(f"{name} auto: {str(error).splitlines()[0]}", flush=True)
    return rows


def _unstated(spec):
    words = ("deformation", "inertia_coupling", "geometric_stiffening", "frame")
    fields = {k: v for k, v in spec.__dict__.items() if k in spec.model_fields_set - {*words}}
    return type(spec).model_construct(_fields_set=set(fields), **fields)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--random", type=int, default=0)
    parser.add_argument("--cases", action="store_true")
    parser.add_argument("--scenes", nargs="*", default=[])
    parser.add_argument("--speeds", nargs="*", type=float, default=SPEEDS)
    arguments = parser.parse_args()
    scenes = [(model.title, model) for model in map(random_model, range(arguments.random))]
    names = arguments.scenes or (list(CASES) if arguments.cases else [])
    scenes += [one for name in names for one in case_models(name, arguments.speeds)]
    warnings.simplefilter("ignore")
    rows = []
    print(f"{'scene':34s}{'left out':10s}{'estimate':>10s}{'truth':>10s}{'ratio':>8s}")
    for name, model in scenes:
        began = time.time()
        with tempfile.TemporaryDirectory() as folder:
            try:
                made = study(name, model, Path(folder))
            except FlexmbError as error:
                print(f"{name}: {str(error).splitlines()[0]}", flush=True)
                continue
        rows += made
        for scene, level, estimated, true in made:
            ratio = min(estimated, 1.0) / min(true, 1.0)
            print(
                f"{scene:34s}{level:10s}{estimated:10.2e}{true:10.2e}{ratio:8.2f}"
                + (f"   {time.time() - began:.0f} s" if level == "auto" else ""), flush=True,
            )  # fmt: skip
    ratios = np.array([
        min(e, 1.0) / min(t, 1.0) for _, level, e, t in rows
        if level != "auto" and max(e, t) > FLOOR and not np.isnan(e)
    ])  # fmt: skip
    within = np.mean((ratios < 3.0) & (ratios > 1 / 3)) if len(ratios) else np.nan
    selected = [true for _, level, _, true in rows if level == "auto"]
    print(f"{len(ratios)} estimates, {100 * within:.0f} % within a factor of three")
    below = sum(true < BUDGET for true in selected)
    print(f"selected effects: {below} of {len(selected)} within the budget of {BUDGET:g}")


if __name__ == "__main__":
    main()
