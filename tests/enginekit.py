"""The engine's units in the hands of tests, and dense views of what they leave.

A `Bench` holds a compiled system with its state and scratch.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from flexmb.engine import equations_of_motion as stages
from flexmb.engine.algebra.ldl import solve_refined
from flexmb.engine.allocation import new_run, new_state, new_work
from flexmb.engine.bodies.motion import move, position_rate
from flexmb.engine.bodies.wrench import add_generalized_force, marker_jacobian
from flexmb.engine.compile import compile_system, with_markers
from flexmb.engine.compiled_units import call, packed_record
from flexmb.engine.iteration_matrix import factorise
from flexmb.engine.joints import constraint
from flexmb.engine.joints.constraint import read_reactions
from flexmb.engine.sensors.sensor import read_channels

STAGES, FACTOR, SOLVE, MOVE, MARKER, REACTIONS = range(6)


def stack_for(table):
    """(depth, 3) scratch for any function of a table."""
    return np.full((table.depth, 3), np.nan)


def run_stages(run, at, out):
    """Every stage at the state: what it leaves is in the work and in `out`; returns the status."""
    work = run.record.work
    call(stages.begin_run, run, at)
    status = call(stages.residual, run, at)
    residual = work.trial.res.copy()
    call(stages.velocity_stage, run, at)
    call(stages.bias_stage, run, at)
    call(stages.complete_poses, run, at)
    call(stages.rate_stage, run, at)
    call(constraint.constraint_right_side, run)
    call(constraint.constraint_jacobian, run)
    call(stages.energies, run, at)
    out[:4] = work.energies[:4]
    call(stages.powers, run, at)
    out[4:7] = work.powers
    angles = run.record.state.angles
    carry_turns(run, at, angles)
    n = len(angles)
    channels = np.full(n, np.nan)
    call(read_channels, run, at, angles, channels)
    out[7 : 7 + n] = channels
    work.trial.res[:] = residual
    return status


def carry_turns(run, at, angles):
    """Carry what counts turns to the present position."""
    near, stage = run.record.work.feedback.near, run.record.stages.angles
    near[: len(angles)] = angles
    for unit, tables in zip(stage.units, stage.tables, strict=True):
        call(unit, run, tables, at)
    angles[:] = near[: len(angles)]


def interpreted(code, folder):
    """As `computed`, with compilation off."""
    return computed(code, folder, NUMBA_DISABLE_JIT="1")


def computed(code, folder, **environment):
    """Run Python code in a process of its own; the arrays it puts into `found`."""
    file = folder / "found.npz"
    paths = [str(Path(__file__).parent), *(path for path in sys.path if path)]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **environment}
    code = f"import numpy as np\nfound = {{}}\n{code}\nnp.savez({str(file)!r}, **found)\n"
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return np.load(file)


def executed(code):
    """Run Python code here; the arrays it puts into `found`."""
    scope = {"np": np, "found": {}}
    exec(code, scope)
    return {name: np.asarray(value) for name, value in scope["found"].items()}


class Bench:
    """A compiled model with state and scratch; arrays are copies, safe to keep."""

    def __init__(self, model):
        self.model = model
        self._key = None
        self.compiled = compile_system(model)
        self.layout = self.compiled.layout
        self.use(self.compiled.system)

    def use(self, system):
        """Work with these tables from now on."""
        self.sys = system
        channels = len(self.layout.channels)
        self.state = new_state(system, channels)
        self.state.angles[:] = np.nan
        self.work = new_work(system)
        size = max(self.layout.nq, 7 + channels, 12 + self.layout.nv)
        self.out = np.full(max(size, 12 * len(system.groups)), np.nan)
        self.q, self.v, self.vd, self.lam = (
            self.state.q, self.state.v, self.state.vd, self.state.lam
        )  # fmt: skip
        self.q[:] = self.compiled.initial_q

    def _handed(self):
        """The run and its point in memory, for these tables."""
        key = self.sys, self.state, self.work
        if self._key is None or any(a is not b for a, b in zip(key, self._key, strict=True)):
            run = new_run(*key)
            self._key, self._packed = key, (packed_record(run), packed_record(run.state_point))
        return self._packed

    def use_rows(self):
        """Take constraint rows that were edited in place for what they are now."""
        markers = self.sys.parts.markers
        markers["point"] = 0  # any row may need axes
        self.use(with_markers(self.sys, markers, self.sys.parts.pool))

    def run(self, what, cv=0.0, cp=0.0, k=0):
        """One part of the engine at the state; what it leaves is in `work` and `out`."""
        run, at = self._handed()
        out, parts, trial = self.out, self.sys.parts, self.work.trial
        if what == STAGES:
            return run_stages(run, at, out)
        if what == FACTOR:
            call(stages.begin_run, run, at)
            call(stages.residual, run, at)
            return call(factorise, run, at, cv, cp)
        if what == SOLVE:
            call(solve_refined, self.sys.kkt, self.work.factor, k)
        elif what == MOVE:
            call(move, parts, self.q, trial.dq, trial.q)
            position_rate(parts, self.q, self.v, out)
        elif what == MARKER:
            call(marker_jacobian, parts, self.work.now, k, self.work.dense.J[0])
            add_generalized_force(parts, self.work.now, k, out, 0, 1.0, out, 6)
        elif what == REACTIONS:
            reactions = np.full(12 * len(self.sys.groups), np.nan)
            call(read_reactions, run, at, reactions)
            out[: len(reactions)] = reactions
        return 0

    def randomise(self, seed, eta=0.3):
        """A random state, anywhere: not on the constraints. Euler parameters of unit length.

        Of a planar model in the plane, all else as placed.
        """
        rng = np.random.default_rng(seed)
        self.state.t[0] = rng.uniform(0.2, 1.5)
        for row in self.sys.parts.bodies:
            i, o, m = row["iq"], row["iv"], row["m"]
            if self.model.plane is None:
                self.q[i : i + 3] = rng.standard_normal(3)
                p = rng.standard_normal(4)
                self.q[i + 3 : i + 7] = p / np.linalg.norm(p)
            else:
                free = self.sys.kkt.column[o : o + 6] >= 0
                self.q[i : i + 3] = np.where(free[:3], rng.standard_normal(3), self.q[i : i + 3])
                turn = np.where(free[3:], rng.uniform(-np.pi, np.pi, 3), 0.0)
                self.q[i + 3 : i + 7] = quaternion_product(self.q[i + 3 : i + 7], exponential(turn))
            self.q[i + 7 : i + 7 + m] = eta * rng.standard_normal(m)
        for s in self.scalars:
            self.q[s["iq"]] = rng.standard_normal()
        for slider in self.sliders:
            # amid a piece, where the curve is a polynomial for differences as well
            k = slider["at"] + rng.integers(slider["n"])
            middle = 0.5 * (self.sys.parts.pool[k] + self.sys.parts.pool[k + 1])
            self.q[self.sys.parts.coordinates[slider["coordinate"]]["iq"]] = middle
        for x in (self.v, self.vd, self.lam):
            x[:] = rng.standard_normal(x.size)
        if self.model.plane is not None:
            n = len(self.v)
            self.v[self.sys.kkt.column[:n] < 0] = self.vd[self.sys.kkt.column[:n] < 0] = 0.0
        return rng

    def at(self, t=None, q=None, v=None, vd=None, lam=None):
        """Evaluate every stage at the state, changed where told."""
        for mine, given in zip(
            (self.state.t, self.q, self.v, self.vd, self.lam), (t, q, v, vd, lam), strict=True
        ):
            if given is not None:
                mine[:] = given
        self.run(STAGES)
        return self

    @property
    def C(self):
        return self.work.con.C.copy()

    @property
    def rate(self):
        return self.work.con.rate.copy()

    @property
    def gamma(self):
        return self.work.con.gamma.copy()

    @property
    def residual(self):
        return self.work.trial.res.copy()

    @property
    def energies(self):
        """Kinetic, strain, gravity, spring."""
        return self.out[:4].copy()

    @property
    def powers(self):
        """Drivers, dampers, loads."""
        return self.out[4:7].copy()

    @property
    def channels(self):
        return self.out[7 : 7 + len(self.layout.channels)].copy()

    def marker(self, field):
        """(markers, ...) values of one field of all markers."""
        return self.work.now.marker[field].copy()

    def body_of(self, marker):
        return int(self.sys.parts.markers["body"][marker])

    def columns(self, body):
        """Where the velocity coordinates of a body are."""
        row = self.sys.parts.bodies[body]
        return slice(int(row["iv"]), int(row["iv"] + 6 + row["m"]))

    @property
    def reactions(self):
        """(groups, 4, 3) force and moment on marker J in its axes, then on I in its axes."""
        before, n = self.out.copy(), len(self.sys.groups)
        self.run(REACTIONS)
        found = self.out[: 12 * n].reshape(n, 4, 3).copy()
        self.out[:] = before
        return found

    @property
    def scalars(self):
        """The scalar coordinates beside the bodies."""
        return self.sys.parts.coordinates

    @property
    def sliders(self):
        """The curve markers."""
        return self.sys.parts.curve_markers

    @property
    def Cq(self):
        """(nc, nv) Jacobian from the rows the kernels wrote."""
        dense = np.zeros((self.layout.nc, self.layout.nv))
        for k, row in enumerate(self.sys.rows):
            for end, field in (("I", "jac_I"), ("J", "jac_J")):
                if row[field] >= 0:
                    where = self.columns(self.body_of(row[end]))
                    n = where.stop - where.start
                    dense[k, where] += self.work.dense.jac[row[field] : row[field] + n]
        for entry in self.sys.coupled:
            column = self.scalars[entry["coordinate"]]["iv"]
            dense[entry["row"], column] = -entry["factor"]
        if len(self.sliders):
            S = self.matrix()
            for slider in self.sliders:
                column = self.scalars[slider["coordinate"]]["iv"]
                dense[:, column] = S[self.layout.nv :, column]
        return dense

    def matrix(self, cv=0.0, cp=0.0, symmetric=False):
        """(nv + nc, nv + nc) iteration matrix without regularisation; also factors it."""
        self.work.factor.symmetric[0] = int(symmetric)
        self.replaced = self.run(FACTOR, cv, cp)
        return self.unpacked()

    def unpacked(self):
        """The matrix in the panels, in the order (v, rows)."""
        kkt, factor = self.sys.kkt, self.work.factor
        up = factor.low0 if factor.symmetric[0] == 1 else factor.up0
        n = len(kkt.place)
        S = np.zeros((n, n))
        for panel in kkt.panels:
            at, nc, nr, col = (int(panel[f]) for f in ("at", "nc", "nr", "col"))
            below = kkt.rows[panel["rows"] : panel["rows"] + nr]
            rows = np.concatenate([np.arange(col, col + nc), below])
            low_part = factor.low0[at : at + (nc + nr) * nc].reshape(-1, nc)
            up_part = up[at : at + (nc + nr) * nc].reshape(-1, nc)
            for i, r in enumerate(rows):
                for j in range(min(i, nc)):
                    S[r, col + j], S[col + j, r] = low_part[i, j], up_part[i, j]
                if i < nc:
                    S[r, r] = low_part[i, i] + factor.eps[r]
        return S[np.ix_(kkt.place, kkt.place)]

    def mass_matrix(self):
        nv = self.layout.nv
        return self.matrix()[:nv, :nv]

    def mass_product(self, x):
        """M x as integrators form it, without the matrix."""
        self.at()
        self.work.trial.res[:] = x
        run, at = self._handed()
        stage = run.record.stages.mass
        for unit, table in zip(stage.units, stage.tables, strict=True):
            call(unit, run, table, at)
        return self.work.factor.sol[self.sys.kkt.place[: self.layout.nv]]

    def solve(self, b, rounds):
        """Solve with the last factor; b in the order (v, rows)."""
        place = self.sys.kkt.place
        self.work.factor.rhs[place] = b
        self.run(SOLVE, k=rounds)
        return self.work.factor.sol[place]

    def accelerations(self, rounds=2):
        """(v̇, λ) at the state, from S (v̇; λ) = (Q; γ); they become the state's."""
        self.matrix(symmetric=True)
        self.at(vd=0.0, lam=0.0)
        x = self.solve(np.concatenate([-self.residual, self.gamma]), rounds)
        self.vd[:], self.lam[:] = np.split(x, [self.layout.nv])
        return self.vd.copy(), self.lam.copy()

    def project(self):
        """Put v on Cq v + C_t = 0 with M as the metric."""
        self.matrix(symmetric=True)
        self.at()
        self.v += self.solve(np.concatenate([0.0 * self.v, -self.rate]), 2)[: self.layout.nv]
        return self.v.copy()

    def moved(self, q, d):
        """q ∘ exp(d), written here once more: quaternion of the rotation vector on the right."""
        q = q.copy()
        for row in self.sys.parts.bodies:
            i, o, m = int(row["iq"]), int(row["iv"]), int(row["m"])
            q[i : i + 3] += d[o : o + 3]
            q[i + 3 : i + 7] = quaternion_product(q[i + 3 : i + 7], exponential(d[o + 3 : o + 6]))
            q[i + 7 : i + 7 + m] += d[o + 6 : o + 6 + m]
        for s in self.scalars:
            q[s["iq"]] += d[s["iv"]]
        return q


def exponential(theta):
    """Unit quaternion of a rotation vector."""
    half = 0.5 * np.linalg.norm(theta)
    return np.concatenate([[np.cos(half)], 0.5 * np.sinc(half / np.pi) * theta])


def quaternion_product(a, b):
    scalar = a[0] * b[0] - a[1:] @ b[1:]
    x, y, z = a[1:]
    u, v, w = b[1:]  # numpy.cross takes most of the time of a test of tangents
    turned = np.array([y * w - z * v, z * u - x * w, x * v - y * u])
    return np.concatenate([[scalar], a[0] * b[1:] + b[0] * a[1:] + turned])


def rotation(p):
    """Direction-cosine matrix of Euler parameters."""
    e, E = p[0], cross_matrix(p[1:])
    return np.eye(3) + 2.0 * e * E + 2.0 * E @ E


def cross_matrix(s):
    return np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])


def slope(f, h=2e-3):
    """df/ds at s = 0 by the six-point central rule: error h⁶f⁽⁷⁾/140, round-off 2u|f|/h."""
    d = [f(k * h) - f(-k * h) for k in (1, 2, 3)]
    return (45.0 * d[0] - 9.0 * d[1] + d[2]) / (60.0 * h)


def curvature(f, h=1e-2):
    """d²f/ds² at s = 0 by the seven-point central rule: error h⁶f⁽⁸⁾/560, round-off 6u|f|/h²."""
    d = [f(k * h) + f(-k * h) for k in (1, 2, 3)]
    return (270.0 * d[0] - 27.0 * d[1] + 2.0 * d[2] - 490.0 * f(0.0)) / (180.0 * h * h)
