"""Scenes that no number of the integrators was chosen by: what accuracy keeps is read off here.

Constants of the step control, its guesses and its verdicts may be measured on the other scenes;
never on these, nor on those of `drives`, `linkages` and `mounts`.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from flexmb.model import Model

from .oscillators import on_rails
from .scene import Scene
from .spinning import top
from .states import system
from .textbook import integrated

G = 9.81


def coupled(size=1.0):
    """Two links side by side, a weak spring between their tips: the swing goes to and fro."""
    made = Model("coupled", gravity=[0, -G * size, 0])
    for k in range(2):
        made.add_marker(f"ground.hook{k}", position=[k * size, 0, 0])
        made.add_body(
            f"b{k}",
            mass=1,
            center=[0, -0.5 * size, 0],
            inertia=[0.1 * size**2] * 3,
            position=[k * size, 0, 0],
            orientation={"axis": "z", "angle": 0.4 * (1 - k)},
        )
        made.add_marker(f"b{k}.tip", position=[0, -size, 0])
        made.add_joint(f"pin{k}", "revolute", between=[f"ground.hook{k}", f"b{k}"], axis="z")
        made.add_sensor(f"tip{k}", "position", of=f"b{k}.tip")
    made.add_force("spring", "spring-damper", between=["b0.tip", "b1.tip"], stiffness=0.5,
                   free_length=size)  # fmt: skip
    return made  # fmt: skip


def coupled_truth(t):
    def slope(_, y):
        a, b = y[:2]
        gap = 1 + np.sin(b) - np.sin(a) - 1j * (np.cos(b) - np.cos(a))
        pull = 0.5 * (abs(gap) - 1) * gap / abs(gap)  # on the first tip
        turn = [(pull * np.exp(-1j * a)).real, -(pull * np.exp(-1j * b)).real]
        return [*y[2:], *((turn - G * 0.5 * np.sin(y[:2])) / 0.35)]

    angle = integrated(slope, [0.4, 0, 0, 0], t)[:2]
    found = {f"tip{k}.x": k + np.sin(angle[k]) for k in range(2)}
    return found | {f"tip{k}.y": -np.cos(angle[k]) for k in range(2)}


def hardening(size=1.0):
    made = on_rails([1], [1.5], size)
    made.add_force("spring", "translational-spring-damper", joint="guide0",
                   spring_force=f"9*x + {200 / size**2!r}*x**3", free=size)  # fmt: skip
    return made


def hardening_truth(t):
    """x'' = −9 x − 200 x³ from rest at 0.5: x = A cn(Ω t | m), Ω² = a + b A²."""
    A, a, b = 0.5, 9.0, 200.0
    w = np.sqrt(a + b * A * A)
    return {"p0.x": 1.0 + A * ellipj(w * t, b * A * A / (2 * w * w))[1]}


_A, _B, _C, _D = 0.1, 0.35, 0.3, 0.4  # crank, coupler, rocker, ground


def _loop(angle):
    """Pins of a four-bar at crank angles, complex."""
    B = _A * np.exp(1j * angle)
    line = _D - B
    length = np.abs(line)
    along = (_B**2 - _C**2 + length**2) / (2 * length)
    return B, B + line / length * (along + 1j * np.sqrt(_B**2 - along**2))


def driven_four_bar(size=1.0):
    made = Model("driven four-bar", gravity=[0, -G * size, 0])
    B, C = (pin * size for pin in _loop(0.0))
    for name, begin, end in (("crank", 0, B), ("coupler", B, C), ("rocker", C, _D * size)):
        bar = end - begin
        made.add_body(name, mass=1, center=[abs(bar) / 2, 0, 0], inertia=[0.01 * size**2] * 3,
                      position=[np.real(begin), np.imag(begin), 0],
                      orientation={"axis": "z", "angle": float(np.angle(bar))})  # fmt: skip
        made.add_marker(f"{name}.end", position=[abs(bar), 0, 0])
    made.add_marker("ground.D", position=[_D * size, 0, 0])
    made.add_joint("A", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("B", "spherical", between=["crank.end", "coupler"])
    made.add_joint("C", "cylindrical", between=["coupler.end", "rocker"], axis="z")
    made.add_joint("D", "revolute", between=["rocker.end", "ground.D"], axis="z")
    made.add_driver("motor", joint="A", angle="10*t + sin(4*t)")
    made.add_sensor("B", "position", of="crank.end")
    made.add_sensor("C", "position", of="coupler.end")
    return made


def driven_four_bar_truth(t):
    B, C = _loop(10 * t + np.sin(4 * t))
    return {"B.x": B.real, "B.y": B.imag, "C.x": C.real, "C.y": C.imag}


def _axis(tilt):
    return np.array([0, -np.sin(tilt), np.cos(tilt)])


_inertia, _mass, _height = (5e-3, 5e-3, 2e-3), 1.0, 0.1
_about = _inertia[0] + _mass * _height**2
_cusps = top(_mass, _height, _inertia, 1.0, tuple(70 * _axis(1.0)))
_spin, _tilt = 50.0, 1.0
_momentum = _inertia[2] * _spin  # about the own axis; about the vertical a thousandth less
_turn = _momentum * (0.999 - np.cos(_tilt)) / (_about * np.sin(_tilt) ** 2)
_pole = top(
    _mass, _height, _inertia, _tilt,
    tuple([-8.0, 0, 0] + _turn * np.array([0, 0, 1])
          + (_spin - _turn * np.cos(_tilt)) * _axis(_tilt)),
)  # fmt: skip


def crane(size=1.0):
    """A cart driven over 50 m, and on it a mass that trembles by 1 mm."""
    made = Model("crane")
    made.add_body("cart", mass=1000, inertia=[size**2] * 3)
    made.add_body("small", mass=0.1, inertia=[size**2] * 3)
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    made.add_joint("guide", "prismatic", between=["cart", "small"], axis="x")
    made.add_force("spring", "translational-spring-damper", joint="guide", stiffness=640)
    made.add_driver("motor", joint="rail", stroke=f"{25 * size!r}*(1 - cos(0.5*t))")
    made.add_sensor("cart", "position", of="cart")
    made.add_sensor("small", "position", of="small", relative_to="cart")
    return made


def crane_truth(t):
    w, W = 80.0, 0.5
    swing = -25 * W**2 / (w * w - W * W) * (np.cos(W * t) - np.cos(w * t))
    return {"cart.x": 25 * (1 - np.cos(W * t)), "small.x": swing}


_LAGS = np.array([0.2, 0.05, 0.5])


def filters_truth(t):
    """T_k y_k' + y_k = y_{k−1}, y_0 = sin 3t, from (1, 0, 0), by eigenvectors."""
    A = np.diag(-1 / _LAGS) + np.diag(1 / _LAGS[1:], -1)
    b, W = np.array([1 / _LAGS[0], 0, 0]), 3.0
    forced = np.linalg.solve(1j * W * np.eye(3) - A, b)  # of exp(iΩt)
    values, vectors = np.linalg.eig(A)
    share = np.linalg.solve(vectors, np.array([1.0, 0, 0]) - forced.imag)
    y = (vectors * share) @ np.exp(np.outer(values, t)) + np.outer(forced, np.exp(1j * W * t)).imag
    return {f"p{k + 1}": y[k].real for k in range(3)}


_FILTERS = system(["(sin(3*t) - y1)/0.2", "(y1 - y2)/0.05", "(y2 - y3)/0.5"], [1.0, 0, 0])


def servo(size=1.0):
    """A mass of 2 kg held by gains of place and speed at a place that moves."""
    made = on_rails([2], [0.0], size)
    made.add_sensor("place", "stroke", joint="guide0")
    made.add_sensor("speed", "stroke", joint="guide0", derivative=1)
    aim = f"{0.2 * size!r}*sin(2*t) + {0.3 * size!r}"
    made.add_force("motor", "force", at="m0", value=[f"800*({aim} - place) - 24*speed", 0, 0])
    return made


def servo_truth(t):
    m, c, k, W = 2.0, 24.0, 800.0, 2.0
    forced = 0.2 * k / (k - m * W * W + 1j * c * W)
    root = (-c + np.sqrt(complex(c * c - 4 * m * k))) / (2 * m)
    x0, v0 = -0.3 - forced.imag, -(1j * W * forced).imag
    share = x0 / 2 + (v0 - root.real * x0) / (2j * root.imag)
    x = 0.3 + (forced * np.exp(1j * W * t)).imag + 2 * (share * np.exp(root * t)).real
    return {"p0.x": x}


_NEAR_TOP = 3.05  # rad from the lowest point


def over_the_top(size=1.0):
    """A link let go a tenth of a radian beside its highest place."""
    made = Model("near its top", gravity=[0, -G * size, 0])
    made.add_body("b", mass=1, center=[0, -0.5 * size, 0], inertia=[0.1 * size**2] * 3,
                  orientation={"axis": "z", "angle": _NEAR_TOP})  # fmt: skip
    made.add_marker("b.end", position=[0, -size, 0])
    made.add_joint("pin", "revolute", between=["ground", "b"], axis="z")
    made.add_sensor("end", "position", of="b.end")
    return made


def over_the_top_truth(t):
    w, k = np.sqrt(G * 0.5 / 0.35), np.sin(_NEAR_TOP / 2)
    angle = 2 * np.arcsin(k * ellipj(ellipk(k * k) + w * t, k * k)[0])
    return {"end.x": np.sin(angle), "end.y": -np.cos(angle)}


def spiral(size=1.0):
    """A charge in a field along z that drags: a coil that narrows and runs off."""
    made = Model("spiral")
    made.add_body("e", mass=1, inertia=[size**2] * 3, velocity=[2 * size, 0, 0.3 * size])
    made.add_sensor("v", "velocity", of="e")
    made.add_force("field", "force", at="e",
                   value=["12*v.y - 0.2*v.x", "-12*v.x - 0.2*v.y", f"{0.1 * size!r} - 0.2*v.z"],
                   )  # fmt: skip
    made.add_sensor("e", "position", of="e")
    return made


def spiral_truth(t):
    rate, pull = -0.2 - 12j, 0.5  # of vx + i vy; speed that the drag ends at
    place = 2 * (np.exp(rate * t) - 1) / rate
    z = pull * t + (0.3 - pull) * (1 - np.exp(-0.2 * t)) / 0.2
    return {"e.x": place.real, "e.y": place.imag, "e.z": z}


_J = np.array([1.0, 2.0, 2.5])
_W0 = np.array([0.0, 1.5, 2.0])  # body axes; ω₁ is zero, where sn begins


def _first_pose():
    """Angle about x that turns the moment of momentum to the z axis."""
    momentum = _J * _W0
    return float(np.arctan2(momentum[1], momentum[2]))


def euler(size=1.0):
    """A body of three inertias, free; its moment of momentum is along z."""
    tilt = _first_pose()
    c, s = np.cos(tilt), np.sin(tilt)
    spin = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ _W0
    made = Model("Euler's body")
    made.add_body("b", mass=1, inertia=(_J * size**2).tolist(), angular_velocity=spin.tolist(),
                  orientation={"axis": "x", "angle": tilt})  # fmt: skip
    for k, axis in enumerate("xyz"):
        made.add_marker(f"b.{axis}", position=[size * (i == k) for i in range(3)])
        made.add_sensor(axis, "position", of=f"b.{axis}")
    return made


def euler_truth(t):
    """Body axes along L by Jacobi's functions; the azimuth of the third by quadrature.

    With J₁ < J₂ < J₃ and L² > 2 T J₂ (Landau & Lifshitz, Mechanics, §37): ω₁ = a₁ cn τ,
    ω₂ = a₂ sn τ, ω₃ = a₃ dn τ.
    """
    J1, J2, J3 = _J
    L2, T2 = np.sum((_J * _W0) ** 2), np.sum(_J * _W0**2)
    assert L2 > T2 * J2
    L = np.sqrt(L2)
    a1 = np.sqrt((T2 * J3 - L2) / (J1 * (J3 - J1)))
    a2 = np.sqrt((T2 * J3 - L2) / (J2 * (J3 - J2)))
    a3 = np.sqrt((L2 - T2 * J1) / (J3 * (J3 - J1)))
    n = np.sqrt((J3 - J2) * (L2 - T2 * J1) / (J1 * J2 * J3))
    m = (J2 - J1) * (T2 * J3 - L2) / ((J3 - J2) * (L2 - T2 * J1))

    def rates(t):
        sn, cn, dn, _ = ellipj(ellipk(m) + n * t, m)  # ω₁ = 0, ω₂ > 0 at t = 0
        return np.array([a1 * cn, a2 * sn, a3 * dn])

    def azimuth(t, _):
        w = rates(t)
        return [L * (J1 * w[0] ** 2 + J2 * w[1] ** 2) / (L2 - (J3 * w[2]) ** 2)]

    up = _J[:, None] * rates(t) / L
    third = integrated(azimuth, [0.0], t)[0] - np.pi / 2
    flat = np.sqrt(1 - up[2] ** 2)
    e3 = np.array([flat * np.cos(third), flat * np.sin(third), up[2]])
    towards = (np.array([[0.0], [0.0], [1.0]]) - up[2] * e3) / flat  # L, as far as across e3
    aside = np.cross(e3, towards, axis=0)
    e1, e2 = (up[0] * towards - up[1] * aside) / flat, (up[1] * towards + up[0] * aside) / flat
    axes = {"x": e1, "y": e2, "z": e3}
    return {f"{name}.{axis}": e[k] for name, e in axes.items() for k, axis in enumerate("xyz")}


_DRAG = 0.02


def projectile(size=1.0):
    """A shot against quadratic drag."""
    made = Model("projectile", gravity=[0, 0, -G * size])
    made.add_body("shot", mass=1, inertia=[size**2] * 3, velocity=[30 * size, 0, 40 * size])
    made.add_sensor("v", "velocity", of="shot")
    speed = f"{_DRAG / size!r}*sqrt(v.x**2 + v.z**2)"
    made.add_force("drag", "force", at="shot", value=[f"-{speed}*v.x", 0, f"-{speed}*v.z"])
    made.add_sensor("shot", "position", of="shot")
    return made


def projectile_truth(t):
    def slope(_, y):
        speed = np.hypot(y[2], y[3])
        return [y[2], y[3], -_DRAG * speed * y[2], -G - _DRAG * speed * y[3]]

    x, z = integrated(slope, [0, 0, 30, 40], t)[:2]
    return {"shot.x": x, "shot.z": z}


def trammel(size=1.0):
    """A rod whose ends slide along two lines that cross: Archimedes' ellipsograph, let go."""
    made = Model("trammel", gravity=[0, -G * size, 0])
    made.add_body("rod", mass=1, center=[0.5 * size, 0, 0], inertia=[0.1 * size**2] * 3)
    made.add_marker("rod.end", position=[size, 0, 0])
    made.add_marker("rod.pen", position=[1.6 * size, 0, 0])
    for name, place, axis, end in (("low", 1.0, "x", "rod.end"), ("high", 0.0, "y", "rod")):
        made.add_body(name, mass=0.5, inertia=[0.01 * size**2] * 3, position=[place * size, 0, 0])
        made.add_joint(f"{name}_guide", "prismatic", between=["ground", name], axis=axis)
        joint = "revolute" if name == "low" else "spherical"
        made.add_joint(f"{name}_pin", joint, between=[name, end],
                       **({"axis": "z"} if name == "low" else {}))  # fmt: skip
        made.add_sensor(name, "position", of=name)
    made.add_sensor("pen", "position", of="rod.pen")
    return made


def trammel_truth(t):
    """Sliders of one mass: ½ (0.1 + ¼ + ½) a'² and (½ + ½) g sin a from rod to the x axis.

    The high slider stands at −sin a, the rod goes from it to cos a: a mathematical pendulum.
    """
    w, k = np.sqrt((0.5 + 0.5) * G / 0.85), np.sin(np.pi / 4)
    turn = 2 * np.arcsin(k * ellipj(ellipk(k * k) + w * t, k * k)[0])  # from the lowest place
    a = np.pi / 2 - turn  # the high slider falls: the slope of the rod rises
    return {
        "low.x": np.cos(a), "high.y": -np.sin(a), "pen.x": 1.6 * np.cos(a),
        "pen.y": 0.6 * np.sin(a),
    }  # fmt: skip


def against_a_stop(size=1.0):
    """A link falls from the horizontal against an elastic stop, again and again."""
    made = Model("pendulum and stop", gravity=[0, -G * size, 0])
    made.add_body("b", mass=1, center=[0.5 * size, 0, 0], inertia=[0.1 * size**2] * 3)
    made.add_marker("b.end", position=[size, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "b"], axis="z")
    made.add_force("stop", "rotational-stop", joint="pin", lower=-1.2, upper=3.0,
                   stiffness=2000 * size**2)  # fmt: skip
    made.add_sensor("end", "position", of="b.end")
    return made


def against_a_stop_truth(t):
    """Pieces between touches, which SciPy finds as roots."""

    def touch(_, y):
        return y[0] + 1.2

    touch.terminal = True
    angle, y, now, pressed = np.zeros(len(t)), [0.0, 0.0], 0.0, False
    while now < t[-1]:

        def slope(_, y, pressed=pressed):
            push = 2000 * (-1.2 - y[0]) if pressed else 0.0
            return [y[1], (push - G * 0.5 * np.cos(y[0])) / 0.35]

        touch.direction = 1.0 if pressed else -1.0
        piece = solve_ivp(slope, (now, t[-1]), y, method="DOP853", rtol=3e-14, atol=1e-15,
                          events=touch, dense_output=True)  # fmt: skip
        inside = (t >= now) & (t <= piece.t[-1])
        angle[inside] = piece.sol(t[inside])[0]
        now, y, pressed = piece.t[-1], piece.y[:, -1], not pressed
    return {"end.x": np.cos(angle), "end.y": np.sin(angle)}


HELD_OUT = {
    "beats": Scene(coupled, 20.0, coupled_truth),
    "hardening spring": Scene(hardening, 5.0, hardening_truth),
    "driven four-bar": Scene(driven_four_bar, 2.0, driven_four_bar_truth),
    "cusps of a top": Scene(_cusps[0], 2.0, _cusps[1]),
    "top past the pole": Scene(_pole[0], 1.5, _pole[1]),
    "crane": Scene(crane, 12.0, crane_truth),
    "filters": Scene(_FILTERS, 5.0, filters_truth, sized=False),
    "servo": Scene(servo, 4.0, servo_truth),
    "pendulum near its top": Scene(over_the_top, 60.0, over_the_top_truth),
    "spiral": Scene(spiral, 8.0, spiral_truth),
    "Euler's body": Scene(euler, 10.0, euler_truth),
    "projectile": Scene(projectile, 6.0, projectile_truth),
    "trammel": Scene(trammel, 3.0, trammel_truth),
    "pendulum against a stop": Scene(against_a_stop, 3.0, against_a_stop_truth),
    "stiff rate": Scene(
        system(["-1e4*(y1 - cos(t)) - sin(t)"], [1.0]), 6.0, lambda t: {"p1": np.cos(t)},
        sized=False, stiff=True,
    ),
}  # fmt: skip
