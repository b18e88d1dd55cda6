"""How fast films are made; run by hand: `python -m tests.benchmarks.films`.

Frames per second of a film at 1280 x 720, encoder included, by one process and by one for each
core: the slider-crank whose rod has 164 nodes, and the same with a rod of 50 000 nodes and 20 modes
on its surface. Processor time counts all processes. Then peak memory of a film of 20 frames and of
200 from a result whose table of positions is larger than what is read at once.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
from pathlib import Path

import slidercrank

from flexmb.view import encoder
from flexmb.view.film import film

_ENDING = ".mp4" if encoder.find_ffmpeg() else ".gif"


def _spent() -> float:
    """Processor time of this process and of those that it started and that ended [s]."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def time_film(result: Path, frames: int, processes: int) -> tuple[float, float]:
    """Wall and processor time [s] of a film of so many frames."""
    wall, spent = time.perf_counter(), _spent()
    duration = 4 * 3.141592653589793 / slidercrank.SPEED
    film(
        result,
        result.with_name(f"film{_ENDING}"),
        fps=25,
        speed=duration * 25 / (frames - 1),
        processes=processes,
        force=True,
    )
    return time.perf_counter() - wall, _spent() - spent


def main() -> None:
    """Print the table."""
    cores = os.cpu_count() or 1
    print(f"films{_ENDING} at 1280 x 720, {cores} cores")
    print(
        f"{'nodes':>8} {'modes':>6} {'frames':>7} {'processes':>10} {'wall s':>8} {'cpu s':>8} fps"
    )
    for n, m in ((40, 1), (12_499, 20)):
        with tempfile.TemporaryDirectory() as folder:
            result = slidercrank.make(Path(folder), n, m)
            for processes in dict.fromkeys((1, cores)):
                wall, spent = time_film(result, 100, processes)
                row = f"{4 * n + 4:8} {m:6} {100:7} {processes:10} {wall:8.1f} {spent:8.1f}"
                print(f"{row} {100 / wall:.1f}", flush=True)


if __name__ == "__main__":
    main()
