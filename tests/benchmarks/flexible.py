"""Steps and time of flexible scenes: `PYTHONPATH=tests python -m tests.benchmarks.flexible`.

Processor time of the integration alone, the least of three, with and without a scout.
"""

from __future__ import annotations

from accuracyscenes.judging import judged
from flexiblescenes import BEAM_PERIOD, four_bar_with_a_beam, suddenly_loaded_beam

from tests.benchmarks.models import reduced_slider_crank

_REPEATS = 3


def main():
    crank, bodies = reduced_slider_crank(20)
    scenes = {
        "slider-crank, two turns": (crank, bodies, {
            "accuracy": 1e-4, "duration": 0.08, "outputs": 400, "start": "quasi-static",
        }),
        "four-bar with a beam, from rest": (
            four_bar_with_a_beam(), None, {"accuracy": 1e-4, "duration": 1.2}
        ),
        "beam loaded suddenly, five swings": (
            suddenly_loaded_beam(), None, {"accuracy": 1e-3, "duration": 5 * BEAM_PERIOD}
        ),
    }  # fmt: skip
    print(f"{'scene':35}{'verify':>7}{'steps':>8}{'scout':>7}{'CPU ms':>9}  told error, method")
    for name, (model, held, knobs) in scenes.items():
        for verify in (True, False):
            found = min(
                (judged(model, None, held, verify=verify, **knobs) for _ in range(_REPEATS)),
                key=lambda one: one.cpu,
            )
            scout = found.statistics.get("comparison_steps", 0)
            print(f"{name:35}{verify!s:>7}{found.steps:8}{scout:7}{1e3 * found.cpu:9.1f}  "
                  f"{found.told:.2g}, {found.statistics['method']}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
