"""Tables: time to equal error beside Exudyn, evaluations beside SciPy, what verifying costs."""

from __future__ import annotations

import sys

import numpy as np

from tests.accuracyscenes.textbook import counted
from tests.peers.scenes import SCENES
from tests.peers.work_precision import Exudyn, Flexmb, fastest, steps_until, time_to

_ERRORS = (1e-4, 1e-5, 1e-6, 1e-8)
_WANTED = {1e-4: 8, 1e-5: 20, 1e-6: 40}
_ACCURACIES = tuple(10.0**-k for k in np.arange(1, 10.1, 0.5))
_REPEATS = 5
_LONGEST = 1.2  # s, of one run of Exudyn


def main():
    names = [name for name in SCENES if not sys.argv[1:] or name in sys.argv[1:]]
    for name in names:
        scene = SCENES[name]
        print(f"\n{name}, {scene.duration:g} s: processor time [ms] to the error at the end")
        print(f"{'':58}" + "".join(f"{error:>10.0e}" for error in _ERRORS))
        ours = {}
        for word, knobs in (("verified", {}), ("verify = false", {"verify": False})):
            one = Flexmb(scene, **knobs)
            one.point(1e-3)  # loads what it compiled
            ours[word] = [fastest(one, accuracy, _REPEATS) for accuracy in _ACCURACIES]
            _row(f"flexmb, {word}", [time_to(ours[word], error) for error in _ERRORS])
        best = _exudyn(name, scene)
        for word, points in ours.items():
            for how, times in best.items():
                ratios = [times[error] / time_to(points, error) for error in _ERRORS]
                _row(f"Exudyn {how} over flexmb, {word}", ratios, "")
        _asked(ours)
        _evaluations(scene, ours["verify = false"])


def _exudyn(name, scene):
    """Least times by error of each way to build the scene."""
    try:
        from tests.peers.with_exudyn import MODELS, solvers
    except ImportError:
        print("Exudyn is not installed: pip install '.[peers]'")
        return {}
    best = {}
    for how, make in MODELS[name].items():
        times = dict.fromkeys(_ERRORS, np.inf)
        for word, settings in solvers(how).items():
            points = steps_until(_ERRORS[2], Exudyn(scene, make, **settings), 20, _LONGEST)
            found = [time_to(points, error) for error in _ERRORS]
            _row(f"Exudyn, {how}{' ' if how else ''}{word}", found)
            times = {e: np.nanmin([times[e], t]) for e, t in zip(_ERRORS, found, strict=True)}
        best[f"({how})" if how else ""] = times
    return best


def _asked(ours):
    """What ten times more accuracy costs, and what the scout does."""
    by = {word: {point.setting: point for point in points} for word, points in ours.items()}
    for word, points in by.items():
        longer = points[1e-8].cpu / points[1e-5].cpu
        print(f"  flexmb, {word}: asked 1e-8 takes {longer:.2f} times as long as asked 1e-5")
    asked = (1e-4, 1e-6, 1e-8)
    shares = [by["verified"][a].cpu / by["verify = false"][a].cpu - 1 for a in asked]
    print("  scout and check over the run alone, asked 1e-4, 1e-6, 1e-8: "
          + ", ".join(f"{share:.2f}" for share in shares))  # fmt: skip


def _evaluations(scene, points):
    """Evaluations for an error beside DOP853 of SciPy in minimal coordinates."""
    theirs = []
    for tolerance in 10.0 ** -np.arange(2, 12.1, 0.5):
        with counted(tolerance) as count:
            truth = scene.truth(np.array([0.0, scene.duration]))
        end = np.array([truth[channel][-1] for channel in scene.channels])
        theirs.append((np.abs(end - scene.end()).max() / scene.size, count[0]))
    for error in _ERRORS:
        we = min((p.evaluations for p in points if p.error <= error), default=np.nan)
        they = min((n for e, n in theirs if e <= error), default=np.nan)
        print(f"  evaluations to {error:.0e}: {we} beside {they} of DOP853: {we / they:.2f}")


def _row(label, values, unit="ms"):
    scale = 1e3 if unit else 1.0
    print(f"  {label:56}" + "".join(f"{scale * value:10.3g}" for value in values), flush=True)


if __name__ == "__main__":
    main()
