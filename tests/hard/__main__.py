"""The table of hard cases: `python -m tests.hard [words of names]`."""

from __future__ import annotations

import sys
import time

import numpy as np

from tests.hard.case import failure, run_case
from tests.hard.chapters import CHAPTERS


def main(words: list[str]) -> int:
    """Print a row of Markdown for each run; the number of failures."""
    wrong = 0
    for chapter, cases in CHAPTERS.items():
        print(f"\n## {chapter}\n\n| case | method | bound | measured | steps | CPU s |")
        print("|---|---|---|---|---|---|")
        for name, case in cases.items():
            for method in case.methods if all(word in name for word in words) else ():
                begin = time.process_time()
                outcome = run_case(case, method)
                spent = time.process_time() - begin
                what = failure(case, method, outcome)
                stopped = f"stops: {outcome.sentences[:110]}"
                measured = stopped if np.isnan(outcome.measured) else f"{outcome.measured:.1e}"
                wrong += bool(what)
                mark = f" **{what[:300]}**" if what else ""
                row = f"{name} | {method} | {case.bound:.0e} | {measured}{mark} | {outcome.steps}"
                print(f"| {row} | {spent:.1f} |", flush=True)
    print(f"\n{wrong} failed")
    return wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]) > 0)
