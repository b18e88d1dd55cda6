"""Studies: what accuracy costs in time over any knob of a scene, and what its error consists of."""

from __future__ import annotations

from flexmb.studies.budget_report import Budget
from flexmb.studies.error_budget import budget
from flexmb.studies.report import Study
from flexmb.studies.rows import Row
from flexmb.studies.runner import study

__all__ = ["Budget", "Row", "Study", "budget", "study"]
