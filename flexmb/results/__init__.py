"""Results: written while a run goes on, readable at any moment, also after a kill."""

from __future__ import annotations

from flexmb.results.extend import extend_file
from flexmb.results.file import OutputBlock, ResultWriter
from flexmb.results.keep import kept_columns, row_bytes
from flexmb.results.layout import BodyColumns, Columns
from flexmb.results.reactions import NOT_UNIQUE, Reaction
from flexmb.results.read import file_format
from flexmb.results.recovered import PeakStress, SectionForces, Stress
from flexmb.results.result import Pose, Result, load_result

__all__ = [
    "NOT_UNIQUE",
    "BodyColumns",
    "Columns",
    "OutputBlock",
    "PeakStress",
    "Pose",
    "Reaction",
    "Result",
    "ResultWriter",
    "SectionForces",
    "Stress",
    "extend_file",
    "file_format",
    "kept_columns",
    "load_result",
    "row_bytes",
]
