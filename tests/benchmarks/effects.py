"""What effects of flexible bodies cost: `PYTHONPATH=tests python -m tests.benchmarks.effects`.

Processor time of the integration alone on the slider-crank with a flexible rod of solids; rounds
over all variants follow each other, and medians of rounds are shown.
"""

from __future__ import annotations

import sys
from statistics import median

from accuracyscenes.judging import judged

from flexmb.engine.compile import compile_system
from flexmb.model.flexible_body import DeformationSpec
from tests.benchmarks import timing
from tests.benchmarks.models import reduced_slider_crank

_ROUNDS = 3
_STEPS = 3000
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
    return {key: median(values) for key, values in table.items()}


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
