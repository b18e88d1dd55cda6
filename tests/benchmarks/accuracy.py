"""What scenes with known solutions achieve and tell: `python -m tests.benchmarks.accuracy`.

One line for each scene, variant and accuracy: the error achieved over the one asked for, the error
told over the true one, steps, passes and processor time; at the end how many miss a factor of two
and of three. Errors below round-off are no misses, nor is an error told of what nobody asked for:
less than a fifth of it.
"""

from __future__ import annotations

import argparse
import functools
import signal
from collections import Counter

import numpy as np

from tests.accuracyscenes import AWAY, CYCLES, SCENES, beside_a_large_motion, moved, truth_of
from tests.accuracyscenes.judging import METHODS, ROUND_OFF, judged

_ASKED = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
_ORDER_TWO = (1e-3, 1e-4, 1e-5)

VARIANTS = {
    "plain": (lambda scene: scene.make(1.0), {}),
    "moved": (lambda scene: moved(scene.make(1.0)), {"away": AWAY}),
    "um": (lambda scene: scene.make(1e-6), {"size": 1e-6}),
    "km": (lambda scene: scene.make(1e3), {"size": 1e3}),
    "beside": (lambda scene: beside_a_large_motion(scene.make(1.0)), {}),
    "cycles": (lambda scene: scene.make(1.0), {}),
}
"""By name: the model, and how its truth differs."""


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("scenes", nargs="*", help="parts of names of scenes; all by default")
    options.add_argument("--method", nargs="+", default=["auto"], choices=METHODS)
    options.add_argument("--variant", nargs="+", default=["plain"], choices=VARIANTS)
    options.add_argument("--accuracy", nargs="+", type=float)
    options.add_argument("--seconds", type=float, default=30.0, help="longest run, processor time")
    options.add_argument("--unverified", action="store_true", help="without comparison run")
    told = options.parse_args()
    knobs = {"verify": False} if told.unverified else {}
    signal.signal(signal.SIGPROF, signal.default_int_handler)  # stops a run as Ctrl-C does
    print(f"{'scene':33}{'variant':8}{'method':13}{'asked':>6}{'achieved':>9}{'told':>9}"
          f"{'steps':>7}{'passes':>7}{'CPU ms':>8}  worst")  # fmt: skip
    count = Counter()
    for name, scene in SCENES.items():
        if told.scenes and not any(part in name for part in told.scenes):
            continue
        for variant in told.variant:
            if not _applies(name, scene, variant):
                continue
            for method in told.method:
                for asked in _asked(told.accuracy, scene, method):
                    signal.setitimer(signal.ITIMER_PROF, told.seconds)
                    _line(count, name, scene, variant, method, asked, knobs)
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    print(f"{count['runs']} runs, {count['failed']} failed; achieved more than twice what was "
          f"asked: {count['missed']}, ten times: {count['missed by ten']}")  # fmt: skip
    print(f"{count['judged']} with an error near what was asked; told less than a third: "
          f"{count['small']}, more than three times: {count['large']}")  # fmt: skip
    print(f"either of all runs, however small their error: {count['off']}")


def _asked(given, scene, method):
    if method in ("explicit-rk", "order 5") and scene.stiff:
        return ()
    return given or (_ORDER_TWO if method == "generalized-alpha" else _ASKED)


def _applies(name, scene, variant):
    if variant == "cycles":
        return name in CYCLES
    return variant == "plain" or scene.sized


@functools.cache
def _truth(name, duration, outputs, size=1.0, away=(0.0, 0.0, 0.0)):
    t = np.linspace(0.0, duration, outputs + 1)
    return truth_of(SCENES[name], t, size, away)


def _line(count, name, scene, variant, method, asked, knobs):
    make, changes = VARIANTS[variant]
    duration = CYCLES[name] if variant == "cycles" else scene.duration
    knobs = {"duration": duration, "outputs": scene.outputs, "accuracy": asked} | knobs
    found = judged(make(scene), lambda t: _truth(name, duration, len(t) - 1, **changes),
                   **knobs, **METHODS[method])  # fmt: skip
    head = f"{name:33}{variant:8}{method:13}{asked:6.0e}"
    count["runs"] += 1
    if found.message:
        count["failed"] += 1
        print(f"{head}  failed: {found.message[:120]}", flush=True)
        return
    marks = ""
    if not found.is_reached(asked):
        marks += " MISSED"
        count["missed"] += 1
        count["missed by ten"] += found.achieved > 10 * asked
    near = found.is_near(asked) and not np.isnan(found.told)
    if found.share < 1 / 3 or not found.share <= 3:
        small = found.share < 1 / 3
        count["off"] += found.achieved > ROUND_OFF
        count["small" if small else "large"] += near
        marks += (" SMALL" if small else " LARGE") if near else ""
    count["judged"] += near
    chosen = found.statistics["method"]
    by = "" if chosen == method else f" by {chosen}"
    print(
        f"{head}{found.achieved / asked:9.2g}{found.share:9.2g}{found.steps:7}"
        f"{found.statistics.get('passes', 1):7}{1e3 * found.cpu:8.1f}  {found.worst}{by}{marks}",
        flush=True,
    )


if __name__ == "__main__":
    main()
