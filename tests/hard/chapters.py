"""The hard cases by what makes them hard."""

from __future__ import annotations

from tests.hard import discontinuity, redundant, singular, spin, starts

CHAPTERS = {
    "Singular positions": singular.CASES,
    "Redundant constraints": redundant.CASES,
    "Spin": spin.CASES,
    "Discontinuity": discontinuity.CASES,
    "Bad starts": starts.CASES,
}
