"""A free body with all its degrees of freedom, against its nodes in the global frame.

The reference knows neither modes nor inertia integrals nor a moving frame of reference: positions
x of the nodes, M of scikit-fem, which is constant, and the strain energy u K u / 2 of the
displacements u = R'(x - c) - X about the mean axes. These turn by the R that makes
sum M_ab |x_a - c - R X_a|^2 least (Kabsch), so that no rigid motion is left in u. The forces are
the derivative of that energy, that of R included.
"""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from scipy.integrate import solve_ivp
from skfem import BilinearForm, CellBasis, ElementVector
from skfem.helpers import ddot, dot, eye, sym_grad, trace

import flexmb
from flexmb.model import Model

E, NU, DENSITY, LENGTH, END = 1e4, 0.3, 1000.0, 0.4, 1.0
PUSH = {"left": (-1.0, -2.0, 0.5), "right": (0.3, 3.0, 2.0)}  # N, times sin^2(pi t)


@BilinearForm
def elasticity(u, v, _):
    mu, lam = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
    strain = sym_grad(u)
    return ddot(2 * mu * strain + lam * eye(trace(strain), 3), sym_grad(v))


@BilinearForm
def inertia(u, v, _):
    return DENSITY * dot(u, v)


def bar() -> CellBasis:
    """Two hexahedra of soft rubber, 12 nodes."""
    axes = [np.linspace(0, size, n) for size, n in ((LENGTH, 3), (0.1, 2), (0.15, 2))]
    mesh = skfem.MeshHex.init_tensor(*axes)
    ends = {"left": lambda x: x[0] == 0, "right": lambda x: x[0] == LENGTH}
    return CellBasis(mesh.with_boundaries(ends), ElementVector(skfem.ElementHex1()), intorder=4)


class Nodes:
    """The equations of motion of the nodes."""

    def __init__(self, basis: CellBasis, K, M) -> None:
        rows = np.ix_(*[basis.nodal_dofs.T.ravel()] * 2)
        self.K, self.m = K.toarray()[rows], M.toarray()[rows][::3, ::3]
        self.x = basis.mesh.p.T.copy()
        self.ends = {"left": self.x[:, 0] == 0, "right": self.x[:, 0] == LENGTH}
        self.X = self.x - self.center(self.x)

    def center(self, x: np.ndarray) -> np.ndarray:
        return self.m.sum(axis=0) @ x / self.m.sum()

    def turn(self, x: np.ndarray) -> np.ndarray:
        U, _, V = np.linalg.svd((x - self.center(x)).T @ self.m @ self.X)
        return U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V

    def energy(self, x: np.ndarray) -> float:
        u = ((x - self.center(x)) @ self.turn(x) - self.X).ravel()
        return 0.5 * float(u @ self.K @ u)

    def forces(self, x: np.ndarray) -> np.ndarray:
        """Derivative of the energy by x (n, 3)."""
        R, weights = self.turn(x), self.m @ self.X
        y = (x - self.center(x)) @ R
        f = (self.K @ (y - self.X).ravel()).reshape(-1, 3)
        J = np.sum(weights * y) * np.eye(3) - y.T @ weights  # J dtheta = sum weights x R' dx
        moment = np.linalg.solve(J.T, np.cross(y, f).sum(axis=0))
        return (f - np.cross(moment, weights)) @ R.T

    def push(self, t: float) -> np.ndarray:
        F = np.zeros_like(self.x)
        for end, value in PUSH.items():
            F[self.ends[end]] = np.array(value) * np.sin(np.pi * t) ** 2 / self.ends[end].sum()
        return F

    def motion(self, times: np.ndarray) -> np.ndarray:
        """Positions (k, n, 3), from rest."""
        inverse = np.linalg.inv(self.m)

        def rates(t: float, state: np.ndarray) -> np.ndarray:
            x, v = state.reshape(2, -1, 3)
            return np.concatenate([v.ravel(), (inverse @ (self.push(t) - self.forces(x))).ravel()])

        begin = np.concatenate([self.x.ravel(), np.zeros(self.x.size)])
        solution = solve_ivp(
            rates, (0.0, times[-1]), begin, method="DOP853", rtol=1e-9, atol=1e-10, t_eval=times
        )
        return solution.y.T.reshape(len(times), 2, -1, 3)[:, 0]


@pytest.fixture(scope="module")
def parts():
    basis = bar()
    K, M = elasticity.assemble(basis), inertia.assemble(basis)
    body = flexmb.reduce(
        basis, stiffness=K, mass=M, modes=24,
        interfaces={end: {"group": end, "type": "rbe3"} for end in PUSH},
    )  # fmt: skip
    assert body.m == 3 * 12 - 6  # nothing is truncated
    nodes = Nodes(basis, K, M)
    return body, nodes, nodes.motion(np.linspace(0.0, END, 11))


def error(parts, coupling: str) -> float:
    """Largest distance of both ends from the reference [m]."""
    body, nodes, motion = parts
    made = Model("free body", gravity=[0, 0, 0])
    made.add_body("bar", body, inertia_coupling=coupling)
    for end, value in PUSH.items():
        force = [f"{component}*sin(pi*t)**2" for component in value]
        made.add_force(end, "force", at=f"bar.{end}", value=force)
        made.add_sensor(end, "position", of=f"bar.{end}")
    made.set_dynamics(duration=END, outputs=10, accuracy=1e-7)
    result = flexmb.simulate(made)
    assert result.status == "finished"
    return max(
        np.abs(np.stack([result[f"{end}.{axis}"] for axis in "xyz"], axis=1) - x).max()
        for end in PUSH
        for x in [motion[:, nodes.ends[end]].mean(axis=1)]
    )


@pytest.mark.seconds
def test_the_forces_of_the_reference_are_those_of_its_energy(parts) -> None:
    _, nodes, motion = parts
    direction = np.random.default_rng(1).standard_normal(nodes.x.shape)
    h = 1e-6
    slope = nodes.energy(motion[-1] + h * direction) - nodes.energy(motion[-1] - h * direction)
    assert np.sum(nodes.forces(motion[-1]) * direction) == pytest.approx(slope / (2 * h), rel=1e-6)


def test_the_bar_turns_and_is_deformed(parts) -> None:
    _, nodes, motion = parts
    angles = [np.arccos(min((np.trace(nodes.turn(x)) - 1) / 2, 1.0)) for x in motion]
    deformed = [np.linalg.norm((x - nodes.center(x)) @ nodes.turn(x) - nodes.X) for x in motion]
    assert max(angles) > 2.0
    assert max(deformed) > 0.02 * LENGTH


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:bodies.bar turns with")
def test_full_coupling_is_exact_and_the_others_are_as_good_as_they_say(parts) -> None:
    """Partial coupling errs by the square of the deformation, constant coupling by the first."""
    full, partial, constant = (error(parts, word) for word in ("full", "partial", "constant"))
    assert full < 1e-8
    assert 1e-6 < partial < 1e-3
    assert 10.0 * partial < constant < 0.05
