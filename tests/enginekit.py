"""The engine's kernels in the hands of tests: one compiled entry for all of them, and dense views.

A `Bench` holds a compiled system with its state and scratch. Features that a model does not use get
empty tables instead of None, so that all tests share one compilation.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from flexmb.engine.compile import compile_system
from flexmb.engine.element_tables import FRAME, LAW, MUTUAL, Elements
from flexmb.engine.functions import lower
from flexmb.engine.jit import entry
from flexmb.engine.kernels import energy
from flexmb.engine.kernels.algebra.ldl import solve_refined
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.bodies.motion import move, position_rate
from flexmb.engine.kernels.bodies.tangent import marker_jacobian
from flexmb.engine.kernels.forces import contact, element, force, joint_friction
from flexmb.engine.kernels.joints import constraint, coordinate, reaction
from flexmb.engine.kernels.kkt import factorise
from flexmb.engine.kernels.residual import position_stage, residual, velocity_stage
from flexmb.engine.kernels.sensors import sensor, signal
from flexmb.engine.sensor_tables import PARTIAL, PULL, Signals
from flexmb.engine.tables import (
    CONTACT,
    COORDINATE,
    JOINT_FRICTION,
    SLIDER,
    SPRING,
)
from flexmb.engine.work import new_state, new_work

NO_SIGNALS = Signals(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, PARTIAL), np.zeros(0, PULL),
    np.zeros(1, np.int64),
)  # fmt: skip
STAGES, FACTOR, SOLVE, MOVE, MARKER, REACTIONS = range(6)


@entry
def run(sys, st, wk, out, what, cv, cp, k):
    """One part of the engine at the state `st`; what it leaves is in `wk` and `out`."""
    now, tr = wk.now, wk.trial
    if what == STAGES:
        bad = residual(sys, wk, st.t[0], st.q, st.v, st.vd, st.lam)
        velocity_stage(sys, wk, st.v)
        kinematics.bias(sys.parts, now, st.v)
        constraint.rates(sys.lines, sys.rows, now.marker, wk.con, wk.dense.g[0])
        constraint.right_side(sys.lines, sys.rows, now.marker, wk.con, wk.dense.g[0])
        constraint.jacobian(sys.lines, sys.parts, now, sys.rows, wk.dense)
        out[0] = energy.kinetic(sys.parts, now, st.v, wk.dense.B)
        out[1] = energy.strain(sys.parts, st.q)
        out[2] = energy.gravitational(sys.parts, now, st.q)
        out[3] = force.spring_energy(sys.springs, now.marker)
        out[3] += coordinate.spring_energy(sys.parts.coordinates, st.q)
        out[3] += contact.energy(sys.contacts, now.marker)
        out[3] += element.energy(sys.elements, sys.parts.coordinates, now, st.v)
        energy.powers(sys, now, wk.con.fun, st.v, st.lam, out[4:7])
        coordinates = sys.parts.coordinates
        out[5] += joint_friction.power(sys.frictions, coordinates, now, st.q, st.v)
        sensor.follow_angles(sys.sensors, now.marker, st.angles)
        sensor.follow_turns(sys.further, sys.sensors, now.marker, st.angles)
        n = st.angles.shape[0]
        sensor.read(
            sys.further, sys, wk, st.t[0], st.q, st.v, st.vd, st.lam, out, st.angles, out[7 : 7 + n]
        )
        return bad
    if what == FACTOR:
        position_stage(sys, wk, st.t[0], st.q)
        signal.stage(sys.signals, sys, wk, st.t[0], st.q, st.v, st.vd, st.lam)
        return factorise(sys, wk, st.v, st.vd, st.lam, cv, cp)
    if what == SOLVE:
        solve_refined(sys.kkt, wk.factor, k)
    elif what == MOVE:
        move(sys.parts, st.q, tr.dq, tr.q)
        position_rate(sys.parts, st.q, st.v, out)
    elif what == MARKER:
        marker_jacobian(sys.parts, now, k, wk.dense.J[0])
        kinematics.add_pulled_back(sys.parts, now, k, out, 0, 1.0, out, 6)
    elif what == REACTIONS:
        reaction.read(sys, now.marker, st.lam, wk.dense.g, out)
    return 0


def plain(system):
    """Whether it holds nothing but bodies, joints, springs, loads, couplers and their sensors."""
    rare = ("elements", "signals", "contacts", "frictions", "further")
    return system.parts.sliders is None and all(getattr(system, name) is None for name in rare)


def padded_plainly(system):
    """The system with empty tables where it has none of what is `plain`."""
    parts = system.parts
    if parts.coordinates is None:
        parts = parts._replace(coordinates=np.zeros(0, COORDINATE))
    return system._replace(
        parts=parts,
        lines=np.zeros(1),
        springs=np.zeros(0, SPRING) if system.springs is None else system.springs,
        kinks=None,
    )


def padded(system):
    """The system with empty tables where it has none."""
    system = padded_plainly(system)
    parts = system.parts
    if parts.sliders is None:
        parts = parts._replace(sliders=np.zeros(0, SLIDER))
    return system._replace(
        parts=parts,
        elements=_padded_elements(system.elements),
        further=np.zeros(1),
        signals=NO_SIGNALS if system.signals is None else system.signals,
        stops=np.zeros(0, np.int64) if system.stops is None else system.stops,
        contacts=np.zeros(0, CONTACT) if system.contacts is None else system.contacts,
        frictions=np.zeros(0, JOINT_FRICTION) if system.frictions is None else system.frictions,
    )


def _padded_elements(elements):
    if elements is None:
        elements = Elements(None, None, None, np.zeros(1), lower([]))
    tables = {"frames": FRAME, "laws": LAW, "mutual": MUTUAL}
    empty = {
        name: np.zeros(0, dtype)
        for name, dtype in tables.items()
        if getattr(elements, name) is None
    }
    return elements._replace(**empty)


def interpreted(code, folder):
    """Run Python code with compilation off; the arrays it puts into `found`.

    It costs no compile time, so analyses that need entries of their own are tested by it.
    """
    file = folder / "found.npz"
    paths = [str(Path(__file__).parent), *(path for path in sys.path if path)]
    env = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(paths)}
    code = f"import numpy as np\nfound = {{}}\n{code}\nnp.savez({str(file)!r}, **found)\n"
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return np.load(file)


class Bench:
    """A compiled model with state and scratch; arrays are copies, safe to keep."""

    def __init__(self, model, as_compiled=False):
        self.compiled = compile_system(model)
        self.layout = self.compiled.layout
        self.use(self.compiled.system if as_compiled else padded(self.compiled.system))
        self.q[:] = self.compiled.placed

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

    def run(self, what, cv=0.0, cp=0.0, k=0):
        return run(self.sys, self.state, self.work, self.out, what, cv, cp, k)

    def randomise(self, seed, eta=0.3):
        """A random state, anywhere: not on the constraints. Euler parameters of unit length."""
        rng = np.random.default_rng(seed)
        self.state.t[0] = rng.uniform(0.2, 1.5)
        for row in self.sys.parts.bodies:
            i, m = row["iq"], row["m"]
            self.q[i : i + 3] = rng.standard_normal(3)
            p = rng.standard_normal(4)
            self.q[i + 3 : i + 7] = p / np.linalg.norm(p)
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
        found = self.sys.parts.coordinates
        return () if found is None else found

    @property
    def sliders(self):
        """The curve markers."""
        found = self.sys.parts.sliders
        return () if found is None else found

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
        for follow in self.sys.follows:
            column = self.scalars[follow["coordinate"]]["iv"]
            dense[follow["row"], column] = -follow["factor"]
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
    return np.concatenate([[scalar], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


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
