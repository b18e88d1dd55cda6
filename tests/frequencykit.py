"""A steel beam of Euler and Bernoulli, and what runs tell of frequencies that are too high."""

from __future__ import annotations

import re

import numpy as np

from flexmb.results import Result
from flexmb.workflow.run import run_single

E, RHO, L, H, B = 2.1e11, 7850.0, 1.0, 0.004, 0.02
STEEL = {"E": E, "nu": 0.3, "density": RHO}
ROOTS = np.array([1.8751041, 4.6940911, 7.8547574, 10.9955407])
OMEGA = ROOTS**2 * np.sqrt(E * H**2 / 12 / RHO) / L**2
TOLD = "for want of modes a natural frequency"


def beam(model, name, modes, at=0.0, size=1.0, height=H, depth=B, **options):
    model.add_body(
        name, mesh={"type": "beam", "length": L * size, "divisions": 20}, material=STEEL,
        sections={"all": {"type": "rectangle", "y": height * size, "z": depth * size}},
        interfaces={"root": "start", "tip": "end"}, modes=modes, position=[at, 0, 0], **options,
    )  # fmt: skip


def ran(model, folder):
    report = run_single(model, folder, pictures=False)
    return Result(report.result), [note for note in report.notes if TOLD in note]


def told(note):
    return float(note.split("is off by about ")[1].split(" %")[0]) / 100


def error(one, other, sensor="tip"):
    a, b = (np.column_stack([run[f"{sensor}.{axis}"] for axis in "xyz"]) for run in (one, other))
    return np.abs(a - b).max() / np.ptp(b, axis=0).max()


def error_told_of(note, one, other):
    """The error of the sensor or reaction that a sentence names."""
    what, name = re.search(r"it: (?:the )?(\w+)(?: of \w+)?\.(\S+) is off", note).groups()
    if what == "sensors":
        channels = [x for x in one.channels() if x.partition(".")[0] == name]
        pairs = [[np.column_stack([run[x] for x in channels]) for run in (one, other)]]
    else:
        pairs = [[getattr(run.reaction(name, on), what) for run in (one, other)] for on in "IJ"]
    return max(np.linalg.norm(a - b, axis=1).max() / np.ptp(b, axis=0).max() for a, b in pairs)
