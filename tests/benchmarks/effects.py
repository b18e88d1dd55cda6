"""What effects of flexible bodies cost: `PYTHONPATH=tests python -m tests.benchmarks.effects`.

Processor time of the integration alone: couplings on the slider-crank with a flexible rod of
solids, geometric stiffening on cranks with a bar of beams, shells and solids. Rounds over all
variants follow each other, and the least of all rounds is shown.
"""

from __future__ import annotations

import sys

import numpy as np
from accuracyscenes.judging import judged
from femeshes import line, solid_box
from shellkit import sheet

from flexmb.engine.compile import compile_system
from flexmb.fe import rectangle, reduce, shell
from flexmb.model import Model
from flexmb.model.flexible_body import DeformationSpec
from tests.benchmarks import timing
from tests.benchmarks.models import reduced_slider_crank

_ROUNDS = 5
_STEPS = 1500
_STIFFENING = ("none", "full")
_DEFORMATIONS = ("rigid", DeformationSpec(dynamic=(0, 1, 2, 3, 4, 5)), "dynamic")


def variant(made, bodies, **words):
    """The slider-crank with other words of its rod."""
    made.bodies["rod"] = made.bodies["rod"].model_copy(update=words)
    return made, compile_system(made, bodies)


def couplings(step, sizes=(24, 26, 58)):
    """µs per step by (modal coordinates, coupling)."""
    table = {}
    fixed = {"dynamics.step": str(step), "dynamics.newton_tolerance": "1e-6"}
    reduced = {modes: reduced_slider_crank(modes, fixed) for modes in sizes}
    for _ in range(_ROUNDS):
        for modes, (made, bodies) in reduced.items():
            for coupling in ("constant", "partial", "full"):
                model, compiled = variant(made, bodies, inertia_coupling=coupling)
                seconds = timing.per_step(model, compiled, step, _STEPS)[0]
                table.setdefault((modes + 6, coupling), []).append(1e6 * seconds)
    return {key: min(values) for key, values in table.items()}


STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7850.0}
BARS = {
    "beams": (lambda: line(40, end=(0.5, 0, 0)), {"all": rectangle(0.02, 0.02)}, "root", "tip"),
    "shells": (
        lambda: sheet(
            (20, 3), shape=lambda x: np.pad(x * [0.5, 0.06] - [0, 0.03], ((0, 0), (0, 1)))
        ),
        {"all": shell(0.01)}, "x0", "x1",
    ),
    "solids": (
        lambda: solid_box("hexahedron20", (14, 2, 1), (0.5, 0.03, 0.02),
                          shape=lambda x: x - [0, 0.015, 0.01]),
        None, "x0", "x1",
    ),
}  # fmt: skip


def crank(kind, modes, step, stiffening):
    """A crank with such a bar as its rod."""
    mesh, sections, root, tip = BARS[kind]
    body = reduce(mesh(), material=STEEL, modes=modes, interfaces={"root": root, "tip": tip},
                  sections=sections, geometric_stiffening=stiffening)  # fmt: skip
    model = Model(f"crank with a rod of {kind}")
    model.add_body("crank", mass=1.0, inertia=[1e-3] * 3)
    model.add_marker("crank.pin", position=[0.1, 0, 0])
    model.add_body("rod", body, position=[0.1, 0, 0])
    model.add_body("slider", mass=0.5, inertia=[1e-3] * 3, position=[0.6, 0, 0])
    model.add_joint("main", "revolute", between=["ground", "crank"], axis="z")
    model.add_joint("pin", "revolute", between=["crank.pin", "rod.root"], axis="z")
    model.add_joint("wrist", "universal", between=["rod.tip", "slider"], axis="y", second_axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    model.add_driver("motor", joint="main", angle="60*t")
    model.set_dynamics(duration=1.0, step=step, newton_tolerance=1e-6)
    return model


def stiffening(step, modes):
    """µs per step by (kind of bar, geometric stiffening)."""
    made = {(kind, word): crank(kind, modes, step, word) for kind in BARS for word in _STIFFENING}
    compiled = {key: compile_system(model) for key, model in made.items()}
    table = {key: [] for key in made}
    for _ in range(_ROUNDS):
        for key, model in made.items():
            table[key].append(1e6 * timing.per_step(model, compiled[key], step, _STEPS // 2)[0])
    return {key: min(values) for key, values in table.items()}


def main():
    for step in (1e-5, 1e-4):
        us = couplings(step)
        print(f"\ngeneralized-alpha, fixed steps of {step:g} s, µs per step")
        print(f"{'modes':>6}{'constant':>10}{'partial':>10}{'full':>10}  partial, full / constant")
        sizes = sorted({m for m, _ in us})
        for m in sizes:
            a, b, c = (us[m, k] for k in ("constant", "partial", "full"))
            print(f"{m:6}{a:10.1f}{b:10.1f}{c:10.1f}  {b / a:.2f}, {c / a:.2f}")
        ratios = (us[sizes[2], k] / us[sizes[1], k] for k in ("constant", "partial", "full"))
        print("64 over 32 modes:", ", ".join(f"{ratio:.2f}" for ratio in ratios), flush=True)
    print(f"\n{'bar':>8}{'modes':>6}{'step':>8}{'without':>10}{'with':>10}  geometric stiffening")
    for modes in (20, 50):
        for step in (1e-5, 1e-4):
            us = stiffening(step, modes)
            for kind in BARS:
                a, b = (us[kind, word] for word in _STIFFENING)
                print(f"{kind:>8}{modes:6}{step:8.0e}{a:10.1f}{b:10.1f}  {b / a:.2f}", flush=True)
    if "--steps" not in sys.argv[1:]:
        return
    print(f"\n{'deformation':>28}{'method':>20}{'steps':>8}{'CPU ms':>9}")
    made, bodies = reduced_slider_crank(20)
    for words in _DEFORMATIONS:
        for method in ("generalized-alpha", "radau", "explicit-rk"):
            model, _ = variant(made, bodies, deformation=words)
            ran = judged(model, None, bodies, method=method, accuracy=1e-3, duration=0.08,
                         outputs=100)  # fmt: skip
            print(f"{words!s:>28}{method:>20}{ran.steps:8}{1e3 * ran.cpu:9.1f}", flush=True)


if __name__ == "__main__":
    main()
