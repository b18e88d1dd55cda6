"""Studies: what accuracy costs in time, over any knob of a scene."""

from __future__ import annotations

from flexmb.studies.report import Row, Study
from flexmb.studies.study import study

__all__ = ["Row", "Study", "study"]
