"""Studies over any knob of a scene: what accuracy costs, what its error consists of, sweeps."""

from __future__ import annotations

from flexmb.studies.budget_report import Budget
from flexmb.studies.error_budget import budget
from flexmb.studies.parameter_sweep import sweep
from flexmb.studies.report import Study
from flexmb.studies.rows import Row
from flexmb.studies.runner import study
from flexmb.studies.sweep_report import Sweep

__all__ = ["Budget", "Row", "Study", "Sweep", "budget", "study", "sweep"]
