"""The hard cases by what makes them hard."""

from __future__ import annotations

from tests.hard import singular

CHAPTERS = {
    "Singular positions": singular.CASES,
}
