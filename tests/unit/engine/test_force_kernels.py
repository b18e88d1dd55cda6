"""Kernels of force elements: tabulated laws, integrals, rotation vectors.

The truth of the interpolations is SciPy's.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import stack_for
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_units import call
from flexmb.engine.forces import relative_motion, spring_damper
from flexmb.engine.forces.stop import stop_resistance
from flexmb.engine.function import lower, run_program
from flexmb.model import Model
from flexmb.model.forces.force_characteristic import CharacteristicOf
from flexmb.model.functions.expression import parse

LAST_DIGITS = 1e-13
X = [-2.0, -1.2, -0.3, 0.4, 0.5, 1.7, 2.5]
Y = [-3.0, -1.0, -0.9, 0.8, 0.7, 2.0, 8.0]


@pytest.fixture(scope="module")
def found():
    found = {}
    at = np.linspace(-4.0, 5.0, 181)
    for name in ("monotone", "akima", "cubic", "linear"):
        found[name] = read(list(zip(X, Y, strict=True)), name, [*at, *X])
        found["two " + name] = read([(1.0, 2.0), (3.0, 8.0)], name, (0.0, 2.0, 4.0))
    texts = ("3*x**5 - x**2 + 2", "exp(x)*cos(3*x)")
    table = lower([parse(text, variable="x") for text in texts])
    found["integrals"] = [
        call(spring_damper.integral, table, k, stack_for(table), s)
        for k in (0, 1)
        for s in (-1.3, 2.0)
    ]

    rng = np.random.default_rng(1)
    turns = rng.standard_normal((40, 3))
    lengths = [*np.geomspace(1e-9, 1.0, 20), *np.linspace(1.1, np.pi - 1e-6, 20)]
    turns *= (lengths / np.linalg.norm(turns, axis=1))[:, None]
    found["turns"] = turns
    found["vectors"] = np.array(
        [relative_motion.rotation_vector(Q) for Q in Rotation.from_rotvec(turns).as_matrix()]
    )
    found["none"] = relative_motion.rotation_vector(np.eye(3))
    coefficients = (0.4999999, 0.5000001, 1e-12, 9.0)
    found["e"] = [relative_motion.inverse_coefficient(s) for s in coefficients]
    return found


def read(points, name, places):
    """(places, 3) force, slope and energy of a tabulated law."""
    made = CharacteristicOf("x", "m", "N").read_characteristic(
        {"points": points, "interpolation": name}, {}
    )
    table = lower([made.expression, made.stored])
    stack = stack_for(table)
    rows = []
    for s in places:
        force = call(run_program, table, 0, s, stack, stack), stack[0, 1]
        rows.append((*force, call(run_program, table, 1, s, stack, stack)))
    return np.array(rows)


TRUTH = {
    "monotone": PchipInterpolator(X, Y),
    "akima": Akima1DInterpolator(X, Y),
    "cubic": CubicSpline(X, Y, bc_type="natural"),
}


@pytest.mark.parametrize("name", TRUTH)
def test_tabulated_laws_are_the_known_splines(found, name):
    """Value, slope and integral from 0 between the points, and straight lines beyond."""
    truth, at = TRUTH[name], np.linspace(-4.0, 5.0, 181)
    value, slope, integral = found[name][: len(at)].T
    inside = (at >= X[0]) & (at <= X[-1])
    area = truth.antiderivative()
    for mine, theirs in (
        (value, truth(at)),
        (slope, truth(at, 1)),
        (integral, area(at) - area(0.0)),
    ):
        np.testing.assert_allclose(mine[inside], theirs[inside], rtol=0, atol=20 * LAST_DIGITS)
    for end, beyond in ((X[0], at < X[0]), (X[-1], at > X[-1])):
        y, d = float(truth(end)), float(truth(end, 1))
        s = at[beyond] - end
        np.testing.assert_allclose(value[beyond], y + d * s, atol=20 * LAST_DIGITS)
        np.testing.assert_allclose(slope[beyond], d, atol=20 * LAST_DIGITS)
        whole = area(end) - area(0.0) + y * s + 0.5 * d * s * s
        np.testing.assert_allclose(integral[beyond], whole, atol=100 * LAST_DIGITS)


def test_a_straight_law(found):
    value, slope, _ = found["linear"].T
    at = np.linspace(-4.0, 5.0, 181)
    inside = (at > X[0]) & (at < X[-1])
    np.testing.assert_allclose(
        value[: len(at)][inside], np.interp(at, X, Y)[inside], atol=20 * LAST_DIGITS
    )
    assert slope[0] == pytest.approx(2.0 / 0.8) and slope[180] == pytest.approx(6.0 / 0.8)


@pytest.mark.parametrize("name", [*TRUTH, "linear"])
def test_they_pass_through_their_points(found, name):
    np.testing.assert_allclose(found[name][181:, 0], Y, rtol=0, atol=LAST_DIGITS)
    # two points make a line through both, y = 3x − 1, its integral from 0 is 3x²/2 − x
    np.testing.assert_allclose(found[f"two {name}"][:, 0], [-1, 5, 11], atol=LAST_DIGITS)
    np.testing.assert_allclose(found[f"two {name}"][:, 2], [0, 4, 20], atol=10 * LAST_DIGITS)


def test_a_monotone_law_makes_no_extremes(found):
    at = np.linspace(-4.0, 5.0, 181)
    value = found["monotone"][:181, 0]
    for k in range(len(X) - 1):
        inside = value[(at >= X[k]) & (at <= X[k + 1])]
        low, high = sorted(Y[k : k + 2])
        assert low - LAST_DIGITS <= inside.min() and inside.max() <= high + LAST_DIGITS


def test_programs_integrate(found):
    """A polynomial exactly; exp(x) cos 3x as (eˣ (cos 3x + 3 sin 3x) − 1)/10."""
    one = [0.5 * s**6 - s**3 / 3.0 + 2.0 * s for s in (-1.3, 2.0)]
    other = [0.1 * (np.exp(s) * (np.cos(3 * s) + 3 * np.sin(3 * s)) - 1.0) for s in (-1.3, 2.0)]
    np.testing.assert_allclose(found["integrals"], [*one, *other], rtol=1e-13)


def test_rotation_vectors_at_all_angles(found):
    np.testing.assert_allclose(found["vectors"], found["turns"], rtol=0, atol=1e-9)
    small = np.linalg.norm(found["turns"], axis=1) < 3.0
    np.testing.assert_allclose(
        found["vectors"][small], found["turns"][small], rtol=0, atol=100 * LAST_DIGITS
    )
    np.testing.assert_array_equal(found["none"], 0.0)
    again = Rotation.from_rotvec(found["vectors"]).as_rotvec()
    np.testing.assert_allclose(again, found["vectors"], atol=1e-9)


def test_the_series_meets_the_closed_form(found):
    """e and its slope on both sides of the switch; 1/12 and 1/720 at nothing; e(3) by hand."""
    before, after, none, large = found["e"]
    assert before[0] - after[0] == pytest.approx(-2e-7 * after[1], abs=1e-15)
    assert before[1] == pytest.approx(after[1], rel=1e-6)
    np.testing.assert_allclose(none, [1 / 12, 1 / 720], rtol=1e-12)
    assert large[0] == pytest.approx((1.0 - 1.5 / np.tan(1.5)) / 9.0, rel=1e-14)


def test_damping_of_a_stop_grows_with_its_depth():
    """By 3 y^2 - 2 y^3 of the depth at which it is whole, beside k p^e."""
    row = {"upper": 1.0, "lower": -np.inf, "depth": 0.2, "exponent": 1.5, "k": 10.0, "c": 4.0}
    for y, share in ((0.25, 0.15625), (0.5, 0.5), (1.5, 1.0)):
        force, _, damping = stop_resistance(row, 1.0 + 0.2 * y, 0.7)
        assert damping == pytest.approx(4.0 * share)
        assert force == pytest.approx(10.0 * (0.2 * y) ** 1.5 + 0.7 * 4.0 * share)


def test_a_stop_is_the_same_in_millimetres():
    """k p^2 of 3 N/mm^2 at 2 mm is 12 N, and so is 3e6 N/m^2 at 2e-3 m."""
    rows = []
    for units, k, upper in (("mm-t-s", 3.0, 5.0), ("SI", 3e6, 5e-3)):
        made = Model("stop", units=units)
        made.add_body("b", mass=1, inertia=[1, 1, 1])
        made.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
        made.add_force("end", "translational-stop", joint="rail", upper=upper, stiffness=k,
                       exponent=2)  # fmt: skip
        rows.append(compile_system(made).system.kinds["force_characteristics"].rows[0])
    assert rows[0]["k"] == pytest.approx(rows[1]["k"], rel=1e-12)
    force, _, _ = stop_resistance(rows[0], 7e-3, 0.0)
    assert force == pytest.approx(12.0, rel=1e-9)
