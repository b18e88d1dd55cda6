"""The page on hard cases: `python -m tests.hard [words of chapters or names]` prints it.

python -m tests.hard > flexmb/manual/hard-cases.md
"""

from __future__ import annotations

import sys

import numpy as np

from tests.hard.case import METHODS, Hard, failure, run_case
from tests.hard.chapters import CHAPTERS

HEAD = """# Hard cases

Scenes that are hard for numbers, what must hold, and what each method does.

A run meets its bar, or stops with the reason. `python -m tests.hard` runs them and prints this
page; those of a minute are part of the tests. How methods choose their steps is said in
[accuracy](accuracy.md).

Measured: in the unit of the bar, with the number of steps in brackets. Fixed steps where a method
has no error control.
"""

TAIL = """## Units and meshes

Machines in metres, millimetres, micrometres and kilometres, with masses and times of other
sizes too, move alike to 1e-8 of the amplitude at fixed steps: a linkage with spring and stop, a
ball with contact and friction, a driven beam (`tests/identities/test_similar_machines.py`).
Slivers are named when a mesh is read. At ν = 0.499 a warning tells the material; the energy of
a thick tube under pressure, two elements thick, is within 1 % with second-order tetrahedra and
wedges, within 3 % with first-order hexahedra, and more than twice with first-order tetrahedra,
of which a warning tells. Models of 307 000 degrees of freedom are in [reduction](reduction.md).

## Interruption

`python -m tests.hard.interruption` ends commands at random moments of their processor time by
kill -9 and by Ctrl-C, with `--pairs` runs each twice at the same time, and with `--disk` on a disk
without room. What must hold: each file under its final name is whole, the older one or the new one;
rows of a killed run are those of the whole run to the last bit, and so is the run when it is
resumed, and those of a study, a sweep or a budget; Ctrl-C ends within a second of the processor; of
two commands in one folder one does its work and the other one says so; a damaged unit of the
compile cache is a missing one; nothing is left over after the next whole command. The older result
stays until the new one has rows.

| phase | measured |
|---|---|
| run, with the reduced body and resumed after each kill | 50 kills: 0 wrong; Ctrl-C: 0.08 s |
| compile, with missing and damaged units | 50 kills, 20 Ctrl-C: 0 wrong, 0.07 s |
| reduce | 50 kills, 20 Ctrl-C: 0 wrong, 0.07 s |
| statics | 50 kills, 17 Ctrl-C: 0 wrong, 0.48 s |
| plot | 50 kills, 17 Ctrl-C: 0 wrong, 0.20 s |
| export | 50 kills, 20 Ctrl-C: 0 wrong, 0.11 s |
| report | 50 kills, 40 Ctrl-C: files whole, 0.70 s; temporary folders stayed, mended |
| film | 50 kills, 40 Ctrl-C: files whole, 0.62 s; a crash of VTK while it was loaded, mended |
| study, sweep, on workers | 25 kills, 10 Ctrl-C each: tables and plots whole, 0.56 s |
| study, sweep, in one process, resumed after each kill | 25 kills, 3 Ctrl-C: same rows, 0.3 s |
| budget | 50 kills, 10 Ctrl-C: same runs, 0 wrong, 0.12 s |
| modes, inverse, response, stress | 50 kills, 10 Ctrl-C each: 0 wrong, 0.42 s |
| audit | 50 kills, 10 Ctrl-C: the result is whole, with or without its table, 0.10 s |
| sweep of 20 000 Sobol samples | 25 Ctrl-C: 6 swallowed, all samples the same; mended, 11 more: 0 |
| two at once: run, reduce, cold cache, study, sweep, budget | 20 pairs each: 0 wrong |
| full disks | run and compile, reduction, report, film, export, with six amounts of room: 0 wrong |
| full disks | plot, export, statics, study, sweep, budget, modes, with four amounts: 0 wrong |
| full disks | audit, inverse, response, stress, with six amounts: stress in HDF5 crashed, mended |

Ctrl-C is held back while a library of others loads a module, calls back or draws samples, where it
would be lost or crash it. A study or sweep with `--fresh` drops the rows of earlier runs at once;
its tables and plots stay until the new ones are whole. On a full disk the rows of ended runs stay.

## Hostile files

`python -m tests.hard.fuzz` lets the commands read mutated expressions, scenes, units and ranges,
tables, sections such as `[study]`, odd TOML, folders of studies, sweeps and budgets, meshes of all
formats, bodies, results and units of the compile cache.
What must hold: a sentence or a result, never a traceback; less than 10 s of the processor and 1 GB;
no file read or written outside of the folders of the input, the cache and Python, no program
started; no control characters. Each input is made from its number, which repeats it.

| inputs | measured |
|---|---|
| 68 000 expressions, 31 400 units and ranges, 11 100 sections | three wrong, mended; 310 MB |
| 23 200 scenes, 2100 of odd TOML, 4800 tables, 1300 units of the cache | 0 wrong; 137 MB |
| 10 600 meshes | 3.4 s, 73 MB but for three, mended: loops, missing nodes |
| 5800 results, 5500 bodies | at most 6.0 s, 131 MB; nine wrong of four kinds, mended |
| 390 folders of studies, sweeps and budgets | a record without times, mended; 4.2 s, 513 MB |

All commands that read a file end with a sentence at eleven kinds of files that are none of theirs
(links in a ring, pipes, devices, folders, empty, damaged, of another program, of a later version)
and at names of 500 characters, with line ends, escapes or bytes that are no Unicode.
"""


def measured(case: Hard, method: str) -> tuple[str, str]:
    """A cell of the table, and what is wrong."""
    outcome = run_case(case, method)
    wrong = failure(case, method, outcome)
    if np.isnan(outcome.measured):
        return "stops", wrong
    value = "told" if np.isinf(case.bound) else f"{outcome.measured:.1e}"
    return f"{value} ({outcome.steps})", wrong


def main(words: list[str]) -> int:
    """Print the page; the number of failures."""
    print(HEAD)
    wrong = 0
    for chapter, cases in CHAPTERS.items():
        names = [name for name in cases if all(word in f"{chapter} {name}" for word in words)]
        if not names:
            continue
        print(f"## {chapter}\n")
        others = any(set(cases[name].methods) - set(METHODS) for name in names)
        columns = [*METHODS, *(["others"] if others else [])]
        print(f"| case | what makes it hard | what must hold | {' | '.join(columns)} |")
        print(f"|{'---|' * (3 + len(columns))}")
        for name in names:
            case = cases[name]
            cells = {method: measured(case, method) for method in case.methods}
            texts = [cells[method][0] if method in cells else "" for method in METHODS]
            if others:
                rest = [f"{k}: {cell[0]}" for k, cell in cells.items() if k not in METHODS]
                texts.append("; ".join(rest))
            print(f"| {name} | {case.why} | {case.bar} | {' | '.join(texts)} |", flush=True)
            for method, (_, what) in cells.items():
                wrong += bool(what)
                print(f"{name}, {method}: {what}\n" if what else "", end="", file=sys.stderr)
        print()
    if not words:
        print(TAIL, end="")
    print(f"{wrong} failed", file=sys.stderr)
    return wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]) > 0)
