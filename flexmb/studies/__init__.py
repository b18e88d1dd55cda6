"""Studies: what accuracy costs in time, over any knob of a scene."""

from __future__ import annotations

from flexmb.studies.report import Study
from flexmb.studies.rows import Row
from flexmb.studies.runner import study

__all__ = ["Row", "Study", "study"]
