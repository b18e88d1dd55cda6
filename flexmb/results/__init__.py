"""Results: written during a run, readable at any moment, also after a kill."""

from __future__ import annotations

from flexmb.results.reader import BodyDamping
from flexmb.results.recovery import SectionForces, ShellForces, Stress
from flexmb.results.result import Pose, Reaction, Result, load_result
from flexmb.results.stress_envelopes import HotSpot, PeakStress, StressEnvelope, export_stress

__all__ = [
    "BodyDamping", "HotSpot", "PeakStress", "Pose", "Reaction", "Result", "SectionForces",
    "ShellForces", "Stress", "StressEnvelope", "export_stress", "load_result",
]  # fmt: skip
