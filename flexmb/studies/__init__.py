"""Studies: what accuracy costs in time, and sweeps, over any knob of a scene."""

from __future__ import annotations

from flexmb.studies.parameter_sweep import sweep
from flexmb.studies.report import Study
from flexmb.studies.rows import Row
from flexmb.studies.runner import study
from flexmb.studies.sweep_report import Sweep

__all__ = ["Row", "Study", "Sweep", "study", "sweep"]
