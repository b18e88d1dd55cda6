"""Every hard case meets its bar, or stops with the right sentence, by each method."""

from __future__ import annotations

import pytest

from tests.hard.case import METHODS, failure, run_case
from tests.hard.chapters import CHAPTERS

RUNS = [
    pytest.param(
        case, method, id=f"{name}-{method}",
        marks=[pytest.mark.slow]
        if (case.slow or method not in METHODS) and method not in case.quick
        else [pytest.mark.seconds] if case.seconds else [],
    )
    for cases in CHAPTERS.values()
    for name, case in cases.items()
    for method in case.methods
]  # fmt: skip


@pytest.mark.parametrize(("case", "method"), RUNS)
def test_it_meets_its_bar_or_stops_with_the_reason(case, method):
    assert not failure(case, method, run_case(case, method))
