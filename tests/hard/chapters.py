"""The hard cases by what makes them hard."""

from __future__ import annotations

from tests.hard import discontinuity, long_time, redundant, scale, singular, spin, starts, stiffness

CHAPTERS = {
    "Singular positions": singular.CASES,
    "Redundant constraints": redundant.CASES,
    "Stiffness and ratios": stiffness.CASES,
    "Spin": spin.CASES,
    "Long time": long_time.CASES,
    "Discontinuity": discontinuity.CASES,
    "Scale": scale.CASES,
    "Bad starts": starts.CASES,
}
