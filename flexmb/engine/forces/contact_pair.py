"""Two surfaces in contact: depth, normal and contact point, their derivatives, the normal force.

With u = x_I − x_J, a = z_J, p = u − (a·u) a, ρ the distance of centres, n the normal from J to I:

    BALL       n = u/ρ,  d = r_I + r_J − ρ,   ρ = |u|
    PLANE      n = a,    d = r_I − n·u
    CYLINDER   n = p/ρ,  d = r_I + r_J − ρ,   ρ = |p|
    BORE       n = −p/ρ, d = r_I − r_J + ρ

The contact point of both bodies is c = x_I − r_I n. A cylinder touches with its lateral surface
only, not with its ends. The normal force is N = K dⁿ (1 + χ ḋ/ḋ₀), or zero where this is negative.
χ follows from the coefficient of restitution; ḋ₀ is the speed of approach at the onset (Hunt &
Crossley, J. Appl. Mech. 42 (1975) 440). The stiffness of the Hertzian contact of two elastic
bodies, n = 3/2, follows from their curvatures: with A ≤ B half the principal curvatures of the gap,
e the eccentricity of the contact ellipse and K(e), E(e) the complete elliptic integrals,

    K = (2π E*/3) K(e)^(−3/2) ((K(e) − E(e))/(e² A))^(1/2),   B/A = (E/(1 − e²) − K)/(K − E),

which for round contact is (4/3) E* √R. Source: Johnson, Contact Mechanics (1985), ch. 4.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine.algebra.vector import column, cross, inner, plus, put_part, times, triple
from flexmb.engine.jit import kernel

if TYPE_CHECKING:
    from flexmb.engine.lowering import Lowering
    from flexmb.model.forces.contact import ContactSpec
    from flexmb.model.markers import PlacedMarker
    from flexmb.model.model import Model

# Shapes of the side J.
BALL, PLANE, CYLINDER, BORE = 0, 1, 2, 3

# Records of impacts of one contact, as indices from its `impacts` on.
# IMPACT: speed of the last impact, m/s (negative while it lasts; 0: there was none); ONSET,
# DEEPEST: its begin, s, and largest depth, m; FASTEST: largest speed of an impact so far, m/s;
# REBOUND: widest gap after an impact slower than the least speed, m.
# A blow is an approach much faster than ḋ₀, for which the damping is set, within a contact that
# lasts. BLOW_WORK, BLOW_SPEED: work of the damping force in blows, J, and largest speed of
# approach, m/s, during the last contact; HARDEST_WORK, HARDEST_SPEED: the same of the contact with
# the largest such work so far (`takes_a_blow`). PEAK: largest normal force at the end of a step, N,
# of all points together, in the record of the last one.
IMPACT, ONSET, DEEPEST, FASTEST, REBOUND, BLOW_WORK, BLOW_SPEED = range(7)
HARDEST_WORK, HARDEST_SPEED, PEAK, IMPACT_HISTORY = range(7, 11)
# Longest duration of an impact, over (largest depth)/(impact speed). If a contact lasts longer, the
# sides are pressed together, and it is no impact.
_MAX_IMPACT_DURATION = 10.0
# Smallest speed of approach of a blow, over ḋ₀; and the smallest work of damping in blows that
# counts, over the elastic energy at the largest depth.
_BLOW_SPEED_RATIO, _BLOW_WORK_RATIO = 10.0, 2.0
_ZERO = (0.0, 0.0, 0.0)


@kernel
def separation(mi, mj):
    """u = x_I − x_J."""
    return plus(triple(mi["x"]), -1.0, triple(mj["x"]))


@kernel
def penetration(c, mi, mj):
    """Depth d, normal n, and the length ρ with δn = (tangential part of δu)/ρ.

    ρ is 0 for a plane, whose normal turns with J, and negative in a bore.
    """
    u = separation(mi, mj)
    if c["kind"] == PLANE:
        n = column(mj["R"], 2)
        return c["ri"] - inner(n, u), n, 0.0
    room = math.inf
    if c["kind"] != BALL:
        a = column(mj["R"], 2)
        s = inner(a, u)
        room = c["half"] - abs(s)
        u = plus(u, -s, a)
    r = math.sqrt(inner(u, u))
    inside = c["kind"] == BORE
    d = c["ri"] - c["rj"] + r if inside else c["ri"] + c["rj"] - r
    if r == 0.0:
        return -c["rj"], _ZERO, 0.0
    r = -r if inside else r
    return min(d, room) if room < 0.0 else d, times(1.0 / r, u), r


@kernel
def relative_velocity(c, n, mi, mj):
    """Velocity g of I relative to J at the contact point."""
    s = times(-c["ri"], n)
    g = plus(triple(mi["vx"]), -1.0, triple(mj["vx"]))
    g = plus(g, 1.0, cross(triple(mi["om"]), s))
    return plus(g, -1.0, cross(triple(mj["om"]), plus(separation(mi, mj), 1.0, s)))


@kernel
def normal_change(c, n, rho, mi, mj, du, turn):
    """Changes of d and n with a change du of u and a rotation `turn` of J."""
    u = separation(mi, mj)
    if c["kind"] == PLANE:
        dn = cross(turn, n)
        return -inner(dn, u) - inner(n, du), dn
    if c["kind"] != BALL:  # change of p, with u and the axis a
        a = column(mj["R"], 2)
        da, s = cross(turn, a), inner(a, u)
        du = plus(du, -s, da)
        du = plus(du, -inner(da, u) - inner(a, du), a)
    across = -inner(n, du)
    return across, times(1.0 / rho, plus(du, across, n))


@kernel
def put_wrench(c, n, mi, mj, f, w):
    """w (12) = the wrench pair of the force f on I and −f on J at the contact point."""
    s = times(-c["ri"], n)
    put_part(w, 0, f)
    put_part(w, 3, cross(s, f))
    put_part(w, 6, times(-1.0, f))
    put_part(w, 9, cross(f, plus(separation(mi, mj), 1.0, s)))


def place_sides(
    lowering: Lowering, spec: ContactSpec
) -> tuple[PlacedMarker, list[PlacedMarker], tuple[int, float, float, float]]:
    """Marker of the side J, markers of the side I; kind, both radii, half length of a cylinder.

    z of the marker J is the normal of a plane or the axis of a cylinder. The markers of the side I
    are the centre of a sphere, or points.
    """
    k = spec.round_side
    side, surface, reference = spec.shapes[k], spec.shapes[1 - k], spec.between[1 - k]
    J = lowering.geometry.frames((reference, reference), getattr(surface, "axis", None))[0]
    if side.type == "sphere":
        points, ri = [lowering.geometry.marker(spec.between[k])], side.radius
    else:
        points, ri = [*lowering.geometry.contact_points(spec.between[k], side)], 0.0
    if surface.type == "sphere":
        return J, points, (BALL, ri, surface.radius, 0.0)
    if surface.type == "plane":
        return J, points, (PLANE, ri, 0.0, 0.0)
    half = math.inf if surface.length is None else 0.5 * surface.length
    return J, points, (BORE if surface.side == "inside" else CYLINDER, ri, surface.radius, half)


@kernel
def normal_force(c, history, d, rate):
    """N, ∂N/∂d and ∂N/∂ḋ at a depth d > 0."""
    speed = max(history[c["history"]], c["slow"])
    elastic, factor = c["K"] * d ** c["n"], 1.0 + c["damping"] * rate / speed
    if factor <= 0.0:
        return 0.0, 0.0, 0.0
    return elastic * factor, c["n"] * elastic / d * factor, elastic * c["damping"] / speed


@kernel
def record_impact(c, d, rate, damping, span, t, before, history):
    """Record speeds of impacts, rebounds after slow ones, and blows on sides in lasting contact.

    c is a contact with depth d, `rate` its ḋ and `damping` its damping force; `before` is the
    history before the step of length `span` that ends at t.
    """
    o, speed = c["impacts"], before[c["history"]]
    impact = history[o + IMPACT]
    if d > 0.0 and impact >= 0.0:
        speed = max(rate, speed if speed > c["slow"] else 0.0, 1e-300)
        speed = speed if span > 0.0 else math.inf  # the run begins with the sides in contact
        history[o + IMPACT], history[o + ONSET], history[o + DEEPEST] = -speed, t, 0.0
        history[o + BLOW_WORK], history[o + BLOW_SPEED] = 0.0, 0.0
        if speed < math.inf:
            history[o + FASTEST] = max(history[o + FASTEST], speed)
    elif d <= 0.0 and impact < 0.0:
        brief = (t - history[o + ONSET]) * -impact <= _MAX_IMPACT_DURATION * history[o + DEEPEST]
        history[o + IMPACT] = -impact if brief else 0.0
        if takes_a_blow(c, history):
            history[o + HARDEST_WORK] = history[o + BLOW_WORK]
            history[o + HARDEST_SPEED] = history[o + BLOW_SPEED]
    if d > 0.0:
        history[o + DEEPEST] = max(history[o + DEEPEST], d)
        if rate > _BLOW_SPEED_RATIO * max(history[c["history"]], c["slow"]):
            history[o + BLOW_WORK] += damping * rate * span
            history[o + BLOW_SPEED] = max(history[o + BLOW_SPEED], rate)
    elif 0.0 < history[o + IMPACT] < c["slow"]:
        history[o + REBOUND] = max(history[o + REBOUND], -d)


@kernel
def takes_a_blow(c, history):
    """Whether the damping work in blows of this contact is the largest so far and dominates.

    It dominates if it exceeds the elastic energy at the largest depth `_BLOW_WORK_RATIO` times: the
    damping force, set for the slow onset, then stops the approach.
    """
    o = c["impacts"]
    elastic = c["K"] * history[o + DEEPEST] ** (c["n"] + 1.0) / (c["n"] + 1.0)
    return history[o + BLOW_WORK] > max(_BLOW_WORK_RATIO * elastic, history[o + HARDEST_WORK])


def normal_parameters(model: Model, spec: ContactSpec) -> tuple[float, float, float, float]:
    """K [N/m^n], exponent n, damping factor χ, and the least speed for ḋ₀ [m/s]."""
    damping = damping_factor(spec.restitution, spec.damping)
    if spec.stiffness is not None:  # the stiffness is for depths in the scene's unit of length
        K = spec.stiffness * model.units.length ** (1.0 - spec.exponent)
        return K, spec.exponent, damping, spec.least_speed
    assert spec.materials is not None  # one of the two is given
    first, second = ((material.E, material.nu) for material in spec.materials)
    K = hertz_stiffness(plane_modulus(first, second), _curvatures(spec))  # type: ignore[arg-type]
    return K, 1.5, damping, spec.least_speed


def _curvatures(spec: ContactSpec) -> tuple[float, float]:
    """Principal relative curvatures of a sphere and the other side [1/m]."""
    k = spec.round_side
    own, other = 1.0 / spec.shapes[k].radius, spec.shapes[1 - k]
    if other.type == "plane":
        return own, own
    curvature = 1.0 / other.radius
    if other.type == "sphere":
        return own + curvature, own + curvature
    return own, own + (-curvature if other.side == "inside" else curvature)


def damping_factor(restitution: float, law: str) -> float:
    """Damping factor χ for a coefficient of restitution in [0, 1].

    >>> damping_factor(1.0, "exact")
    0.0
    """
    e = restitution
    if e == 1.0:
        return 0.0
    if law == "flores":
        return 8.0 * (1.0 - e) / (5.0 * e)
    if law == "lankarani-nikravesh":
        return 0.75 * (1.0 - e * e)
    low, high = 0.0, 1.0 / e
    # bisection for the root of χ (1 + e) = ln((1 + χ)/(1 − χ e)), whose right side is the larger
    # one beyond the root
    for _ in range(200):
        chi = 0.5 * (low + high)
        more = math.log1p(chi) - math.log1p(-chi * e) if chi * e < 1.0 else math.inf
        low, high = (chi, high) if chi * (1.0 + e) > more else (low, chi)
    return 0.5 * (low + high)


_CIRCLE_TOLERANCE = 1e-6  # relative difference of curvatures below which the ellipse is a circle


def plane_modulus(first: tuple[float, float], second: tuple[float, float]) -> float:
    """Contact modulus E* [Pa] of two materials (E [Pa], ν): 1/E* = (1 − ν₁²)/E₁ + (1 − ν₂²)/E₂."""
    return 1.0 / sum((1.0 - nu * nu) / E for E, nu in (first, second))


def hertz_stiffness(modulus: float, curvatures: tuple[float, float]) -> float:
    """K [N/m^1.5] from E* [Pa] and the two principal relative curvatures [1/m], both positive.

    >>> round(hertz_stiffness(3.0, (1.0, 1.0)), 9)
    4.0
    """
    A, B = sorted(0.5 * c for c in curvatures)
    if B - A <= _CIRCLE_TOLERANCE * B:
        return 4.0 / 3.0 * modulus / math.sqrt(A + B)
    low, high = 0.0, 1.0  # bisection for e²: B/A grows with e² from 1 to infinity
    for _ in range(100):
        m = 0.5 * (low + high)
        K, E = _elliptic(m)
        low, high = (m, high) if (E / (1.0 - m) - K) / (K - E) < B / A else (low, m)
    K, E = _elliptic(m)
    return 2.0 * math.pi * modulus / 3.0 * K**-1.5 * math.sqrt((K - E) / (m * A))


def _elliptic(m: float) -> tuple[float, float]:
    """Complete elliptic integrals K, E of m = e², by the arithmetic-geometric mean."""
    a, b, total, power = 1.0, math.sqrt(1.0 - m), 0.5 * m, 0.5
    while abs(a - b) > 1e-15 * a:
        c = 0.5 * (a - b)
        a, b = 0.5 * (a + b), math.sqrt(a * b)
        power *= 2.0
        total += power * c * c
    K = 0.5 * math.pi / a
    return K, K * (1.0 - total)
