"""Studies over any knob of a scene: what accuracy costs, what its error consists of, sweeps."""

from __future__ import annotations

from flexmb.studies.accuracy.report import Study
from flexmb.studies.accuracy.rows import Row
from flexmb.studies.accuracy.runner import study
from flexmb.studies.budgets.budget_report import Budget
from flexmb.studies.budgets.error_budget import budget
from flexmb.studies.sweeps.parameter_sweep import sweep
from flexmb.studies.sweeps.sweep_report import Sweep

__all__ = ["Budget", "Row", "Study", "Sweep", "budget", "study", "sweep"]
