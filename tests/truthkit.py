"""Runs in memory for tests that compare with known truth: models in, arrays over time out."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from enginekit import Bench
from scipy.spatial.transform import Rotation

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.dynamics.dynamics import dynamics
from flexmb.engine import method
from flexmb.engine.allocation import new_output, new_run, new_work
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_calls import integrate, solve_stage
from flexmb.engine.initial_conditions import ACCELERATIONS, BEGIN, VELOCITIES
from flexmb.results.output_block import OutputBlock

_REFERENCES = Path(__file__).parent / "references"


def reference(file, name=None):
    """A table of reference values, each with its source."""
    table = json.loads((_REFERENCES / f"{file}.json").read_text())
    return table if name is None else table[name]


def stiffness_and_mass(model):
    """K and M (nv, nv) of a model without joints, at rest in its placed pose."""
    bench = Bench(model)
    M = bench.mass_matrix()
    return bench.matrix(cp=1.0)[: len(M), : len(M)] - M, M


class Memory:
    """Keeps the rows of a run."""

    def __init__(self):
        self.blocks = []

    def append(self, block):
        self.blocks.append(block)

    def save_state(self, state):
        pass

    def restart(self):
        self.blocks.clear()

    def tables(self):
        return [np.concatenate(parts) for parts in zip(*self._rows(), strict=True)]

    def _rows(self):
        names = ("t", "q", "v", "vd", "lam", "reactions", "sensors", "energy", "drift")
        return [[getattr(block, name) for name in names] for block in self.blocks]


@dataclass
class Run:
    """Rows of a run; `run["slider.x"]` is a channel."""

    layout: object
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    vd: np.ndarray
    lam: np.ndarray
    reactions: np.ndarray
    sensors: np.ndarray
    energy: np.ndarray
    drift: np.ndarray
    statistics: dict

    def __getitem__(self, channel):
        return self.sensors[:, self.layout.channels.index(channel)]

    def vector(self, sensor):
        """(n, 3) of a marker sensor."""
        return np.stack([self[f"{sensor}.{axis}"] for axis in "xyz"], axis=1)

    def reaction(self, name):
        """(n, rows) multipliers of one joint or driver, in the order of its rows."""
        found = [k for k, row in enumerate(self.layout.rows) if row.split(":")[0] == name]
        return self.lam[:, found]

    def stored(self, *columns):
        """Sum of energies by name."""
        at = [self.layout.energies.index(column) for column in columns]
        return self.energy[:, at].sum(axis=1)

    def mismatch(self):
        """Largest departure of stored energy less works from its first value [J]."""
        balance = self.energy[:, :4].sum(axis=1) - self.energy[:, 4:].sum(axis=1)
        return np.abs(balance - balance[0]).max()

    def at(self, times):
        """Row numbers of output times, which must be there."""
        rows = np.rint(np.asarray(times) / (self.t[1] - self.t[0])).astype(int)
        np.testing.assert_allclose(self.t[rows], times, rtol=1e-9)
        return rows


def run(model, **knobs):
    """Run a model by `analysis.dynamics`, as a user's run does, without files."""
    model.set_dynamics(**knobs)
    made, memory = compile_system(model), Memory()
    outcome = dynamics(made, model, memory)
    assert outcome.status == "finished", outcome.message
    return Run(made.layout, *memory.tables(), outcome.statistics)


def steps(model, chosen, h, count, every, start=None, **settings):
    """Run `count` steps through the engine's own loop; returns a Run, the state and the scratch.

    `start(state, layout)` may change positions and velocities of the assembled state; velocities
    are then put on the constraints again, and accelerations and multipliers solved.
    """
    made = compile_system(model)
    state = assemble(made, model).state
    if start is not None:
        start(state, made.layout)
        scratch = new_work(made.system)
        for level in (VELOCITIES, ACCELERATIONS, BEGIN):
            solve_stage(made.system, state, scratch, level)
        state.aa[:] = state.vd
    work = new_work(made.system, len(made.layout.channels), chosen)
    knobs = method.Settings(
        **{
            "start": 0.0, "end": count * h, "interval": (every or count) * h, "step": h,
            "tolerance": 0.0, "accuracy": 0.0, "rejection_factor": 1.0, "max_rotation": 1.0,
            "refinement": 0.0, "least_motion": 1e-6, "newton_tolerance": 1e-10,
            "max_iterations": 15,
            "does_work": 1, "stiff": 1, "static_after_step": 0,
            "determinate": 0,
            **settings,
        }
    )  # fmt: skip
    rows = count // (every or count) + 4
    out = new_output(made.system, rows, len(made.layout.channels))
    status = integrate(new_run(made.system, state, work, chosen, knobs, output=out), count)
    assert status == method.SUCCESS, status
    tables = [np.array(table[1 : int(out.rows[0])]) for table in out[: len(fields(OutputBlock))]]
    return Run(made.layout, *tables, {}), state, work


def momentum(clouds, result):
    """(n, 6) momentum and moment of momentum about the global origin, (n, 3) centre of mass.

    Summed over the point masses (`generators.Cloud`) of all bodies, in the model's order.
    """
    total, center = np.zeros((len(result.t), 6)), np.zeros((len(result.t), 3))
    for cloud, body in zip(clouds, result.layout.bodies, strict=True):
        q = result.q[:, body.iq : body.iq + 7 + body.m]
        v = result.v[:, body.iv : body.iv + 6 + body.m]
        A = Rotation.from_quat(q[:, [4, 5, 6, 3]]).as_matrix()
        s = cloud.s + np.einsum("kam,nm->nka", cloud.N, q[:, 7:])
        rate = np.einsum("kam,nm->nka", cloud.N, v[:, 6:])
        x = q[:, None, :3] + s @ A.transpose(0, 2, 1)
        speed = v[:, None, :3] + (np.cross(v[:, None, 3:6], s) + rate) @ A.transpose(0, 2, 1)
        carried = cloud.mass[:, None] * speed
        total += np.hstack([carried.sum(axis=1), np.cross(x, carried).sum(axis=1)])
        center += cloud.mass @ x
    return total, center / sum(cloud.mass.sum() for cloud in clouds)


def order(h, errors):
    """Observed order of convergence: slope of log error over log h."""
    return np.polyfit(np.log(h), np.log(errors), 1)[0]


def extrapolated(coarse, fine, p=2):
    """Richardson's value from steps h and h/2 of a method of order p."""
    return fine + (fine - coarse) / (2**p - 1)
