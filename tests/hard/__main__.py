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
    print(f"{wrong} failed", file=sys.stderr)
    return wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]) > 0)
