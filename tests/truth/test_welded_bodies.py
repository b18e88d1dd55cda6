"""Large deflection: bodies welded in a row converge to a geometrically exact beam.

Each body is linear in its own frame. A cantilever under a transverse force at its tip, that of K.
Mattiasson, Numerical results from large deflection beam and frame problems analysed by means of
elliptic integrals, Int. J. Numer. Meth. Engng 17 (1981) 145-153, is cut into n bodies. His table is
checked by the boundary value problem of the elastica, theta'' = -k cos(theta).
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from femeshes import line
from scipy.integrate import quad, solve_bvp

import flexmb
from flexmb.errors import FlexmbWarning
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

E, LENGTH, THICK = 2.1e11, 1.0, 0.005
STIFFNESS = E * THICK**4 / 12
STEEL = {"E": E, "nu": 0.3, "density": 7800.0}
MATTIASSON = {1.0: (0.30172, 0.05643), 2.0: (0.49346, 0.16064), 5.0: (0.71379, 0.38763)}
"""P L^2/EI: deflection and shortening at the tip over the length."""


def elastica(k: float) -> np.ndarray:
    """Deflection and shortening of the tip for P L^2/EI = k, over the length."""
    s = np.linspace(0.0, 1.0, 100)
    solution = solve_bvp(
        lambda _, y: np.array([y[1], -k * np.cos(y[0])]),
        lambda a, b: np.array([a[0], b[1]]),
        s, np.stack([s * min(k / 2, 1.0), 0 * s]), tol=1e-9,
    )  # fmt: skip
    assert solution.success
    theta = solution.sol
    up, along = (
        quad(lambda x, f=f: f(theta(x)[0]), 0.0, 1.0, epsabs=1e-10)[0] for f in (np.sin, np.cos)
    )
    return np.array([up, 1.0 - along])


def tip(n: int, k: float, stiffening: str, origin: tuple[float, float, float]) -> np.ndarray:
    """Deflection and shortening of the tip of n welded bodies, over the length."""
    part = LENGTH / n
    body = reduce(
        line(4, end=(part, 0, 0)), material=STEEL, modes=0,
        interfaces={"root": "root", "tip": "tip"},
        sections={"all": rectangle(THICK, THICK, shear=False)}, geometric_stiffening=stiffening,
    )  # fmt: skip
    made = Model("bodies welded in a row", gravity=[0, 0, 0])
    made.add_marker("ground.clamp", position=list(origin))
    for i in range(n):
        place = [origin[0] + i * part, *origin[1:]]
        made.add_body(f"b{i}", body, position=place, geometric_stiffening=stiffening)
        base = "ground.clamp" if i == 0 else f"b{i - 1}.tip"
        made.add_joint(f"weld{i}", "fixed", between=[base, f"b{i}.root"])
    made.add_force("load", "force", at=f"b{n - 1}.tip", value=[0, k * STIFFNESS / LENGTH**2, 0])
    made.add_sensor("tip", "position", of=f"b{n - 1}.tip")
    result = flexmb.statics(made)
    moved = [result[f"tip.{axis}"][-1] - at for axis, at in zip("xy", origin, strict=False)]
    return np.array([moved[1], LENGTH - moved[0]]) / LENGTH


@pytest.mark.parametrize("k", MATTIASSON)
def test_the_elastica_is_that_of_the_paper(k: float) -> None:
    np.testing.assert_allclose(elastica(k), MATTIASSON[k], atol=6e-6)


@pytest.mark.parametrize(
    ("stiffening", "order", "last"), [("none", 2.0, 8e-4), ("full", 4.0, 4e-5)]
)
def test_welded_bodies_converge_to_the_elastica(stiffening: str, order: float, last: float) -> None:
    """Of second order in the length of a body; with geometric stiffening of fourth order."""
    errors = np.array([tip(n, 2.0, stiffening, (0, 0, 0)) - elastica(2.0) for n in (2, 4, 6)])
    sizes = np.linalg.norm(errors, axis=1)
    slope = np.log(sizes[0] / sizes[2]) / np.log(3.0)
    assert slope == pytest.approx(order, abs=0.35)
    assert sizes[2] < 1.5 * last


def test_a_bend_of_70_degrees_a_kilometre_away() -> None:
    place = (1000.0, -300.0, 50.0)
    np.testing.assert_allclose(tip(8, 5.0, "full", place), MATTIASSON[5.0], atol=2.5e-4)


def test_a_body_alone_that_bends_too_far_is_named() -> None:
    with pytest.warns(FlexmbWarning, match="bodies.b0 is deflected by 0.5[0-9]* of its length"):
        tip(1, 2.0, "full", (0, 0, 0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        tip(8, 2.0, "full", (0, 0, 0))
    assert not [one for one in caught if "deflected" in str(one.message)]
