"""The three angles that turn the axes of one marker into those of another, for any sequence.

R = R_Iᵀ R_J = R_i(α) R_j(β) R_k(γ), each turn about the axes that the turns before have left. With
s = ±1 for the parity of (i, j, third axis): three different axes (Cardan, Bryan) have
sin β = s R_ik, singular at ±90°; two (Euler, k = i) have cos β = R_ii, singular at 0 and 180°. Of
the two triples of angles, (α, β, γ) and (α + π, π − β or −β, γ + π), the one nearer to the angles
before is taken, so that they go on without a jump, through a singular pose too if the motion leads
through it; at it γ stays and α takes the whole turn (Shuster, A Survey of Attitude Representations,
J. Astronaut. Sci. 41 (1993) 439, sec. 6).
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.joints.dots import dot_columns
from flexmb.engine.kernels.joints.primitive import wrapped

# Sine or cosine of β below which the pose counts as singular: α and γ have no digits there.
_SINGULAR = 1e-8


@kernel
def axes(markers, term):
    """Direction cosines of the two markers of a term."""
    return markers[term["I"]]["R"], markers[term["J"]]["R"]


@kernel
def sequence(code):
    """Axes i, j, k of a sequence 9 i + 3 j + k, the third axis beside i and j, and the parity."""
    i, j, k = code // 9, (code // 3) % 3, code % 3
    return i, j, k, 3 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0


@kernel
def angles(code, Ri, Rj, before, b1, b2):
    """α, β, γ nearest to those before, NaN for none: then β within 0..180° or ±90°."""
    i, j, k, m, s = sequence(code)
    y = dot_columns(Ri, i, Rj, j)
    if i == k:
        x = dot_columns(Ri, i, Rj, m)
        across = math.hypot(x, y)
        first = math.atan2(dot_columns(Ri, j, Rj, i), -s * dot_columns(Ri, m, Rj, i))
        second = math.atan2(across, dot_columns(Ri, i, Rj, i))
        third = math.atan2(y, s * x)
    else:
        x = dot_columns(Ri, i, Rj, i)
        across = math.hypot(x, y)
        first = math.atan2(-s * dot_columns(Ri, j, Rj, k), dot_columns(Ri, k, Rj, k))
        second = math.atan2(s * dot_columns(Ri, i, Rj, k), across)
        third = math.atan2(-s * y, x)
    if across < _SINGULAR:
        third = 0.0 if math.isnan(b2) else b2
        first = _whole_turn(i, j, k, m, s, third, Ri, Rj)
    if math.isnan(before):
        return first, second, third
    other = -second if i == k else math.pi - second
    p, q, r = first + math.pi, other, third + math.pi
    near = abs(wrapped(first - before)) + abs(wrapped(second - b1)) + abs(wrapped(third - b2))
    far = abs(wrapped(p - before)) + abs(wrapped(q - b1)) + abs(wrapped(r - b2))
    if far < near and across >= _SINGULAR:
        first, second, third = p, q, r
    return before + wrapped(first - before), b1 + wrapped(second - b1), b2 + wrapped(third - b2)


@kernel
def _whole_turn(i, j, k, m, s, third, Ri, Rj):
    """α with γ given: column j of R R_k(−γ) is that of R_i(α)."""
    c, d = math.cos(third), s * math.sin(third)
    p, f = (m, -d) if i == k else (i, d)
    up = c * dot_columns(Ri, m, Rj, j) + f * dot_columns(Ri, m, Rj, p)
    on = c * dot_columns(Ri, j, Rj, j) + f * dot_columns(Ri, j, Rj, p)
    return math.atan2(s * up, on)


@kernel
def gradient(code, number, Ri, Rj, first):
    """d with (rate of angle `number`) = d·(ω_J − ω_I), global axes; α is `first`.

    ω = α̇ n₁ + β̇ n₂ + γ̇ n₃ with the three axes as they are; d is the dual of its axis.
    """
    i, j, k, m, s = sequence(code)
    c, d = math.cos(first), s * math.sin(first)
    x = c * Ri[0, j] + d * Ri[0, m]
    y = c * Ri[1, j] + d * Ri[1, m]
    z = c * Ri[2, j] + d * Ri[2, m]
    px, py, pz = cross(x, y, z, Rj[0, k], Rj[1, k], Rj[2, k])
    volume = Ri[0, i] * px + Ri[1, i] * py + Ri[2, i] * pz
    if number == 1:
        px, py, pz = cross(Rj[0, k], Rj[1, k], Rj[2, k], Ri[0, i], Ri[1, i], Ri[2, i])
    elif number == 2:
        px, py, pz = cross(Ri[0, i], Ri[1, i], Ri[2, i], x, y, z)
    return px / volume, py / volume, pz / volume
