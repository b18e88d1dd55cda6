"""Kinematic analysis of five-body planar linkages: time per point, and compile time."""

from __future__ import annotations

import time
from statistics import median

import numpy as np

from flexmb.analysis.kinematics import prepare_kinematics
from flexmb.engine import method
from flexmb.engine.allocation import new_output, new_run
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_calls import analyse_kinematics
from flexmb.engine.kinematics_loop import POINTS
from tests.quickreturn import quick_return

_REPEATS = 5
_POINTS = 100_000


def per_point(model):
    """Median CPU time of a point [s] of one compiled run with all output; iterations, factors."""
    compiled = compile_system(model)
    seconds = []
    for _ in range(_REPEATS):
        ready = prepare_kinematics(compiled, model)
        n = ready.points
        output = new_output(compiled.system, n, len(compiled.layout.channels))
        run = new_run(compiled.system, ready.pose.state, ready.pose.work, output=output)
        begin = time.process_time()
        status = analyse_kinematics(run, ready.pose.path, ready.settings, POINTS, n)
        seconds.append((time.process_time() - begin) / n)
        assert status == method.SUCCESS, status
    return median(seconds), np.array(ready.pose.path.count[0].item()) / n


def main():
    begin = time.perf_counter()
    prepare_kinematics(compile_system(quick_return()), quick_return())
    print(f"ready after {time.perf_counter() - begin:.1f} s (units compiled or loaded)")
    print("\nQuick-return, positions, velocities, accelerations, reactions, energies of all points")
    print(f"{'model':>24} {'points/turn':>12} {'us/point':>9} {'iterations':>11} {'factors':>8}")
    for kind, plane in (("A", "xy"), ("C", "xy"), ("A", None)):
        for per_turn in (200, 360, 1000):
            made = quick_return(kind, plane, _POINTS / per_turn, _POINTS)
            seconds, iterations, factors = per_point(made)
            name = f"{kind}, {len(made.bodies)} bodies, {plane or 'in space'}"
            print(
                f"{name:>24} {per_turn:12} {1e6 * seconds:9.2f} {iterations:11.2f} {factors:8.2f}"
            )


if __name__ == "__main__":
    main()
