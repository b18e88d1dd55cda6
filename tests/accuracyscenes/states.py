"""States without bodies: problems of the test set of initial value problems (Bari, CWI)."""

from __future__ import annotations

from flexmb.model import Model

from .scene import Scene
from .textbook import integrated

_STIFF = {"method": "Radau", "rtol": 1e-12}


def system(rates, first):
    """Model of states y1, y2, ... with rates, seen by sensors p1, p2, ... of a length."""

    def make(size=1.0):
        made = Model("states")
        made.add_body("still", mass=1, inertia=[1, 1, 1])
        for k, (rate, start) in enumerate(zip(rates, first, strict=True), start=1):
            made.add_state(f"y{k}", rate=rate, start=start)
        for k in range(1, len(rates) + 1):
            made.add_sensor(f"p{k}", "expression", value=f"y{k}", unit="m")
        return made

    return make


def solved(slope, first, which=None, **knobs):
    """Truth of such a model, by SciPy; `which` are the states that are judged."""

    def truth(t):
        y = integrated(slope, first, t, **knobs)
        return {f"p{k}": y[k - 1] for k in which or range(1, len(first) + 1)}

    return truth


def van_der_pol(mu, duration, outputs=100):
    """ÿ = µ (1 − y²) ẏ − y."""
    stiff = mu > 10

    def slope(_, y):
        return [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]]

    def jacobian(_, y):
        return [[0, 1], [-2 * mu * y[0] * y[1] - 1, mu * (1 - y[0] ** 2)]]

    knobs = {**_STIFF, "jac": jacobian, "atol": 1e-13} if stiff else {}
    make = system(["y2", f"{mu}*(1 - y1**2)*y2 - y1"], [2.0, 0.0])
    truth = solved(slope, [2.0, 0.0], **knobs)
    return Scene(make, duration, truth, sized=False, stiff=stiff, outputs=outputs)


def _robertson(_, y):
    one, two, three = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    return [two - one, one - two - three, three]


def _robertson_jacobian(_, y):
    return [
        [-0.04, 1e4 * y[2], 1e4 * y[1]],
        [0.04, -1e4 * y[2] - 6e7 * y[1], -1e4 * y[1]],
        [0, 6e7 * y[1], 0],
    ]  # fmt: skip


_HIRES = (
    "-1.71*y1 + 0.43*y2 + 8.32*y3 + 0.0007",
    "1.71*y1 - 8.75*y2",
    "-10.03*y3 + 0.43*y4 + 0.035*y5",
    "8.32*y2 + 1.71*y3 - 1.12*y4",
    "-1.745*y5 + 0.43*y6 + 0.43*y7",
    "-280*y6*y8 + 0.69*y4 + 1.71*y5 - 0.43*y6 + 0.69*y7",
    "280*y6*y8 - 1.81*y7",
    "-280*y6*y8 + 1.81*y7",
)
_HIRES_FIRST = [1.0, 0, 0, 0, 0, 0, 0, 0.0057]
HIRES_END = (
    0.7371312573325668e-3, 0.1442485726316185e-3, 0.5888729740967575e-4, 0.1175651343283149e-2,
    0.2386356198831331e-2, 0.6238968252742796e-2, 0.2849998395185769e-2, 0.2850001604814231e-2,
)  # fmt: skip
"""At t = 321.8122."""

_OREGO = ("77.27*(y2 + y1*(1 - 8.375e-6*y1 - y2))", "(y3 - (1 + y1)*y2)/77.27", "0.161*(y1 - y3)")
OREGO_END = (0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3)
"""At t = 360."""


# Pollution: 20 substances, of which one has 4e-18 of the others and a rate of 4e11 1/s.
_REACTIONS = {
    1: "0.35*y1", 2: "26.6*y2*y4", 3: "1.23e4*y5*y2", 4: "8.6e-4*y7", 5: "8.2e-4*y7",
    6: "1.5e4*y7*y6", 7: "1.3e-4*y9", 8: "2.4e4*y9*y6", 9: "1.65e4*y11*y2", 10: "9e3*y11*y1",
    11: "0.022*y13", 12: "1.2e4*y10*y2", 13: "1.88*y14", 14: "1.63e4*y1*y6", 15: "4.8e6*y3",
    16: "3.5e-4*y4", 17: "0.0175*y4", 18: "1e8*y16", 19: "4.44e11*y16", 20: "1.24e3*y17*y6",
    21: "2.1*y19", 22: "5.78*y19", 23: "0.0474*y1*y4", 24: "1.78e3*y19*y1", 25: "3.12*y20",
}  # fmt: skip
_SUBSTANCES = (  # numbers of the reactions that make (+) and use (-) each
    (-1, -10, -14, -23, -24, 2, 3, 9, 11, 12, 22, 25), (-2, -3, -9, -12, 1, 21),
    (-15, 1, 17, 19, 22), (-2, -16, -17, -23, 15), (-3, 4, 4, 6, 7, 13, 20),
    (-6, -8, -14, -20, 3, 18, 18), (-4, -5, -6, 13), (4, 5, 6, 7), (-7, -8), (-12, 7, 9),
    (-9, -10, 8, 11), (9,), (-11, 10), (-13, 12), (14,), (-18, -19, 16), (-20,), (20,),
    (-21, -22, -24, 23, 25), (-25, 24),
)  # fmt: skip
_POLLUTION = tuple(
    "".join(f"{'+' if k > 0 else '-'}{_REACTIONS[abs(k)]}" for k in one) for one in _SUBSTANCES
)
_POLLUTION_FIRST = [0, 0.2, 0, 0.04, 0, 0, 0.1, 0.3, 0.01, *[0] * 7, 0.007, 0, 0, 0]
POLLUTION_END = (
    0.5646255480022769e-1, 0.1342484130422339, 0.4139734331099427e-8, 0.5523140207484359e-2,
    0.2018977262302196e-6, 0.1464541863493966e-6, 0.7784249118997964e-1, 0.3245075353396018,
    0.7494013383880406e-2, 0.1622293157301561e-7, 0.1135863833257075e-7, 0.2230505975721359e-2,
    0.2087162882798630e-3, 0.1396921016840158e-4, 0.8964884856898295e-2, 0.4352846369330103e-17,
    0.6899219696263405e-2, 0.1007803037365946e-3, 0.1772146513969984e-5, 0.5682943292316392e-4,
)  # fmt: skip
"""At t = 60."""

_E5 = (
    "-7.89e-10*y1 - 1.1e7*y1*y3", "7.89e-10*y1 - 1.13e9*y2*y3",
    "7.89e-10*y1 - 1.1e7*y1*y3 - 1.13e9*y2*y3 + 1.13e3*y4", "1.1e7*y1*y3 - 1.13e3*y4",
)  # fmt: skip


def _rates(texts):
    """The rates as a Python function of t and y."""
    code = compile("[" + ", ".join(texts) + "]", "rates", "eval")
    names = [f"y{k}" for k in range(1, len(texts) + 1)]
    return lambda t, y: eval(code, dict(zip(names, y, strict=True)))


_predator = ("2*y1 - y1*y2", "0.5*y1*y2 - y2")

STATES = {
    "van der Pol, µ = 1": van_der_pol(1, 20.0),
    "van der Pol, µ = 100": van_der_pol(100, 200.0, 200),
    "van der Pol, µ = 1000": van_der_pol(1000, 2000.0, 200),
    "Robertson": Scene(
        system(["-0.04*y1 + 1e4*y2*y3", "0.04*y1 - 1e4*y2*y3 - 3e7*y2**2", "3e7*y2**2"], [1, 0, 0]),
        1000.0,
        solved(_robertson, [1, 0, 0], [1, 2, 3], **_STIFF, jac=_robertson_jacobian, atol=1e-18),
        sized=False, stiff=True,
    ),
    "HIRES": Scene(
        system(_HIRES, _HIRES_FIRST), 321.8122,
        solved(_rates(_HIRES), _HIRES_FIRST, **_STIFF, atol=1e-17), sized=False, stiff=True,
    ),
    "OREGO": Scene(
        system(_OREGO, [1.0, 2.0, 3.0]), 360.0,
        solved(_rates(_OREGO), [1.0, 2.0, 3.0], **_STIFF, atol=1e-12), sized=False, stiff=True,
    ),
    "pollution": Scene(
        system(_POLLUTION, _POLLUTION_FIRST), 60.0,
        solved(_rates(_POLLUTION), _POLLUTION_FIRST, **_STIFF, atol=1e-22), sized=False, stiff=True,
    ),
    "E5": Scene(
        system(_E5, [1.76e-3, 0, 0, 0]), 1e5,
        solved(_rates(_E5), [1.76e-3, 0, 0, 0], **_STIFF, atol=1e-30), sized=False, stiff=True,
    ),
    "predator and prey": Scene(
        system(_predator, [1.0, 1.0]), 20.0, solved(_rates(_predator), [1.0, 1.0]), sized=False
    ),
}  # fmt: skip
