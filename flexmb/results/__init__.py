"""Results: written during a run, readable at any moment, also after a kill."""

from __future__ import annotations

from flexmb.engine.tables import BodyColumns
from flexmb.results.channels import Columns, row_bytes, stored_columns
from flexmb.results.export import write_vtu
from flexmb.results.reader import DAMPING, BodyDamping, damping_text
from flexmb.results.recovery import SectionForces, ShellForces, Stress
from flexmb.results.result import NOT_UNIQUE, Pose, Reaction, Result, load_result
from flexmb.results.result_file import extend_file, file_format, store_text
from flexmb.results.stress_envelopes import HotSpot, PeakStress, StressEnvelope, export_stress
from flexmb.results.writer import OutputBlock, ResultWriter

__all__ = [
    "DAMPING",
    "NOT_UNIQUE",
    "BodyColumns",
    "BodyDamping",
    "Columns",
    "HotSpot",
    "OutputBlock",
    "PeakStress",
    "Pose",
    "Reaction",
    "Result",
    "ResultWriter",
    "SectionForces",
    "ShellForces",
    "Stress",
    "StressEnvelope",
    "damping_text",
    "export_stress",
    "extend_file",
    "file_format",
    "load_result",
    "row_bytes",
    "store_text",
    "stored_columns",
    "write_vtu",
]
