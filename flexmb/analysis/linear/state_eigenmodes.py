"""Modes of M ÿ + D ẏ + K y = 0, damped and gyroscopic: eigenvalues λ and shapes φ, y = φ e^{λt}.

Without D, and with K symmetric, ω² are the eigenvalues of the pair (K, M); else λ are those of the
first-order equations. Three measures keep the accuracy of soft motions beside stiff modes:
coordinates are in order of stiffness, so that a Cholesky factor of M does not carry stiffness into
soft ones; low frequencies come from the inverse problem; and of ω² below the round-off of the
largest the shapes are freed from what stiff modes left in them. What is then below the bound of
Kato and Temple, |Ky − ω²y|² over the distance to the next ω², or below the round-off of K, is zero:
a rigid motion. It takes no part in the first-order equations, where neither D nor K resists it.

Whirl: modes of a motion written in rotating axes, as the ground sees them. In axes that rotate with
n about z a point moves by x + iy = p e^{iωt} + b* e^{−iωt}, with p = (φx + iφy)/2 and
b = (φx − iφy)/2 of its complex shape φ. Seen from the ground it is multiplied by e^{int}: p rotates
with ω + n and b with n − ω; motion along z keeps ω. A mode of a rotor of revolution has only one of
the three; of other modes the largest is taken. A rotor whirls in the sense of rotation (forward) or
against it (backward).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import one_blas_thread
from flexmb.analysis.linear.observer import MinimalEquations, body_axes
from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import skew

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_ASYMMETRY = 1e-9  # A − Aᵀ that is round-off, over the largest element
_WIDE_SPECTRUM = 1e6  # ratio of ω² above which the lower half comes from the inverse problem
_UNRESOLVED = 1e-12  # ω² over the largest one below which the eigenvalue problem does not know it
_RESIDUAL_SAFETY = 10.0  # on the bound of Kato and Temple
_UNDERFLOW = 1e-40  # ω² over the largest one that only products of round-off make
_ROUND_OFF = 1e-13  # relative round-off of a Rayleigh quotient, over the sum of its terms
_NEGLIGIBLE = 1e-14  # relative size of damping terms that are round-off
_EQUAL_SHAPES = 1e-3  # distance of two unit shapes that are the same rigid motion
_MAX_NODES = 200  # nodes of a body whose motion is evaluated
_DOMINANT_SHARE = 0.9  # share of one frequency in a mode above which it is its only one


@dataclass(frozen=True)
class Eigenmodes:
    """Eigenvalues (k,) 1/s in order of size, one of each complex pair, and shapes (n, k) of y."""

    values: Complex
    shapes: Complex


@one_blas_thread()
def eigenmodes(
    M: Array, D: Array, K: Array, states: NDArray[np.bool_], rate: float = 0.0
) -> Eigenmodes:
    """Modes of the matrices (n, n); coordinates in `states` exist only as rates.

    `rate` [1/s] is that of the motion about which is linearised: its terms in K may cancel, which
    raises the round-off.

    Raises
    ------
    FlexmbError
        A motion has no inertia.
    """
    n = len(M)
    if n == 0:
        return Eigenmodes(np.zeros(0, complex), np.zeros((0, 0), complex))
    diagonal = np.diag(M)
    if np.any(diagonal <= 0.0):
        raise FlexmbError(
            "a motion that the joints allow has no inertia, so it has no modes: give the body "
            "there a mass and moments of inertia"
        )
    order = np.argsort(np.abs(np.diag(K)) / diagonal, kind="stable")
    M, D, K = (matrix[np.ix_(order, order)] for matrix in (M, D, K))
    try:
        half = np.linalg.inv(np.linalg.cholesky(0.5 * (M + M.T)))
    except np.linalg.LinAlgError:
        raise FlexmbError(
            "the mass matrix of the free motions is not positive definite: a motion has no inertia"
        ) from None
    Ms, Ds, Ks = half @ M @ half.T, half @ D @ half.T, half @ K @ half.T
    symmetric = not states.any() and _is_symmetric(Ks) and _is_symmetric(Ms)
    if symmetric and _is_small(D, K, M):
        values, shapes = _undamped(Ks)
    elif symmetric and (rigid := _unresisted(Ds, Ks)).shape[1]:
        rest = np.linalg.qr(rigid, mode="complete").Q[:, rigid.shape[1] :]
        inner = [rest.T @ each @ rest for each in (Ms, Ds, Ks)]
        values, shapes = _damped(inner[0], inner[1], inner[2], np.zeros(rest.shape[1], bool))
        values = np.concatenate([np.zeros(rigid.shape[1]), values])
        shapes = np.hstack([rigid, rest @ shapes])
    else:
        values, shapes = _damped(Ms, Ds, Ks, states[order])
    shapes = half.T @ shapes
    values = _clean_eigenvalues(values, shapes, (M, D, K), rate)
    out = np.zeros_like(shapes)
    out[order] = shapes
    by_size = _unique_motions(values, out, np.argsort(np.abs(values), kind="stable"))
    return Eigenmodes(values[by_size], out[:, by_size])


def _is_symmetric(A: Array) -> bool:
    return bool(np.abs(A - A.T).max() <= _ASYMMETRY * np.abs(A).max(initial=1e-300))


def _is_small(D: Array, K: Array, M: Array) -> bool:
    """Whether D is round-off compared with K and M."""
    size = np.sqrt(np.outer(np.abs(np.diag(K)), np.diag(M)))
    return bool(np.all(np.abs(D) <= _NEGLIGIBLE * np.maximum(size, size.max() * _NEGLIGIBLE)))


def _undamped(K: Array) -> tuple[Complex, Complex]:
    """λ = √(−ω²) and shapes of K y = ω² y, K symmetric (n, n)."""
    K = 0.5 * (K + K.T)
    squares, shapes = _squares(K)
    if squares[0] > 0.0 and squares[-1] > _WIDE_SPECTRUM * squares[0]:
        with suppress(np.linalg.LinAlgError):  # the least square is round-off: a rigid motion
            half = np.linalg.inv(np.linalg.cholesky(K))  # K⁻¹ = halfᵀ half
            inverse, low = np.linalg.eigh(half.T @ half)
            below = squares < np.sqrt(squares[0] * squares[-1])
            squares[below], shapes[:, below] = 1.0 / inverse[::-1][below], low[:, ::-1][:, below]
    return np.sqrt(-squares + 0j), shapes.astype(complex)


def _squares(K: Array) -> tuple[Array, Array]:
    """ω² (n,) and shapes (n, n) of K y = ω² y, K symmetric; those of rigid motions are zero."""
    squares, shapes = np.linalg.eigh(K)
    soft = np.abs(squares) <= _UNRESOLVED * np.abs(squares).max()
    if soft.any() and not soft.all():
        low, stiff, above = shapes[:, soft], shapes[:, ~soft], squares[~soft]
        for _ in range(2):
            low = np.linalg.qr(low - stiff @ ((stiff.T @ K @ low) / above[:, None])).Q
        values, turn = np.linalg.eigh(low.T @ K @ low)
        low = low @ turn
        residual = np.linalg.norm(K @ low - values * low, axis=0)
        limit = _RESIDUAL_SAFETY * residual**2 / np.abs(above).min()
        limit += _ROUND_OFF * np.einsum("ik,ik->k", np.abs(low), np.abs(K) @ np.abs(low))
        squares[soft], shapes[:, soft] = np.where(np.abs(values) <= limit, 0.0, values), low
    squares[np.abs(squares) <= _ROUND_OFF**2 * np.abs(squares).max()] = 0.0
    return squares, shapes


def _unresisted(D: Array, K: Array) -> Array:
    """(n, k) rigid motions that damping does not resist either."""
    squares, shapes = _squares(0.5 * (K + K.T))
    rigid = shapes[:, squares == 0.0]
    resistance = max(np.abs(D @ rigid).max(initial=0.0), np.abs(rigid.T @ D).max(initial=0.0))
    return rigid if resistance <= _ROUND_OFF * np.abs(D).max() else rigid[:, :0]


def _damped(M: Array, D: Array, K: Array, states: NDArray[np.bool_]) -> tuple[Complex, Complex]:
    """λ and shapes of the first-order equations, one of each conjugate pair."""
    n = len(M)
    lower = np.hstack([-K, -D])
    if not _is_symmetric(M - np.eye(n)) or np.abs(M - np.eye(n)).max() > _ASYMMETRY:
        lower = np.asarray(np.linalg.solve(M, lower), np.float64)
    A = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), lower])
    columns = np.concatenate([~states, np.ones(n, bool)])
    values, vectors = np.linalg.eig(A[np.ix_(columns, columns)])
    whole = np.zeros((2 * n, len(values)), complex)
    whole[columns] = vectors
    one = values.imag >= 0.0
    values, whole = values[one].astype(complex), whole[:, one]
    # the larger half of (φ, λφ) is the more accurate one
    upper, rate = whole[:n], whole[n:]
    slow = np.abs(values) <= 1.0
    shapes = np.where(slow, upper, rate)
    shapes[states] = rate[states]
    return values, shapes


def _clean_eigenvalues(
    values: Complex, shapes: Complex, of: tuple[Array, Array, Array], rate: float
) -> Complex:
    """Eigenvalues; those below the round-off of the matrices are set to zero."""
    size = np.abs(shapes)
    mass, damping, stiffness = (np.einsum("ik,ik->k", size, np.abs(matrix) @ size) for matrix in of)
    limit = _ROUND_OFF * (stiffness / mass + (damping / mass) ** 2 + 100.0 * rate**2)
    limit = limit + _UNDERFLOW * np.abs(values).max(initial=0.0) ** 2
    values = np.where(np.abs(values) ** 2 <= limit, 0.0, values)
    noise = np.abs(values.real) <= _NEGLIGIBLE * 100.0 * np.abs(values).max(initial=0.0)
    return np.where(noise, 1j * values.imag, values)


def _unique_motions(
    values: Complex, shapes: Complex, order: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The order without repeated zero eigenvalues of the same rigid motion."""
    selection: list[int] = []
    basis = np.zeros((len(shapes), 0), complex)
    for k in order:
        if values[k] == 0.0:
            shape = shapes[:, k] / np.linalg.norm(shapes[:, k])
            rest = shape - basis @ (basis.conj().T @ shape)
            if np.linalg.norm(rest) < _EQUAL_SHAPES:
                continue
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
        selection.append(int(k))
    return np.array(selection, np.int64)


@dataclass(frozen=True)
class Whirl:
    """Modes as the ground sees them.

    Attributes
    ----------
    modes : Eigenmodes
        λ of the largest part of their motion, in order of size; shapes in the rotating axes.
    senses : tuple of str
        "forward", "backward", or "" for motion along the axis.
    shares : (k,) array
        Share of that part in the motion of the mode.
    """

    modes: Eigenmodes
    senses: tuple[str, ...]
    shares: Array

    @property
    def mixed(self) -> list[int]:
        """Numbers from 1 of the modes that have more than one frequency."""
        return [k + 1 for k, share in enumerate(self.shares) if share < _DOMINANT_SHARE]


def whirl(seen: MinimalEquations, modes: Eigenmodes) -> Whirl:
    """Modes in rotating axes, as the ground sees them."""
    turn = seen.observer.w
    n = float(np.linalg.norm(turn))
    z = turn / n
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    along = np.stack([x, np.cross(z, x), z]) @ _motions(seen, modes)  # (points, 3, k)
    parts = np.stack([along[:, 0] + 1j * along[:, 1], along[:, 0] - 1j * along[:, 1]])
    sizes = np.array([*0.5 * (np.abs(parts) ** 2).sum(axis=1), (np.abs(along[:, 2]) ** 2).sum(0)])
    largest, whole = sizes.argmax(axis=0), sizes.sum(axis=0)
    shares = sizes.max(axis=0, initial=0.0) / np.where(whole > 0.0, whole, 1.0)
    values, still = modes.values, whole == 0.0  # still: a mode of states of controllers alone
    round_ = np.where(largest == 0, values, values.conj()) + 1j * n
    is_axial = (largest == len(parts)) | still
    values = np.where(is_axial, values, round_)
    is_backward = values.imag < 0.0
    senses = np.where(is_axial, "", np.where(is_backward, "backward", "forward"))
    # Of each pair the λ with Im λ > 0 is taken: shapes of p belong to λ, those of b to λ*.
    is_other = is_backward ^ ((largest == 1) & ~is_axial)
    shapes = np.where(is_other, modes.shapes.conj(), modes.shapes)
    values = np.where(is_backward, values.conj(), values)
    order = np.argsort(np.abs(values), kind="stable")
    shares = np.where(still, 1.0, shares)[order]
    turned = Eigenmodes(values[order], shapes[:, order])
    return Whirl(turned, tuple(map(str, senses[order])), shares)


def _motions(seen: MinimalEquations, modes: Eigenmodes) -> Complex:
    """(points, 3, k) motion of points of all bodies in the observer's axes, times √mass."""
    compiled, R = seen.compiled, seen.observer.R
    motion = seen.coordinates.N @ modes.shapes
    parts: list[Complex] = []
    for body, A in zip(compiled.layout.bodies, body_axes(compiled, seen.state.q), strict=True):
        own, k = R.T @ A, body.iv
        record = compiled.system.parts.bodies[len(parts)]
        mass, spread = float(record["mass"]), np.asarray(record["S0"])
        flexible = compiled.bodies.get(body.name)
        if flexible is None or not flexible.m:
            center = np.asarray(record["S1"]) / mass if mass else np.zeros(3)
            arms = np.array([center])
            bent = np.zeros((1, 3, motion.shape[1]), complex)
        else:
            nodes = flexible.nodes
            if nodes is None:
                arms = np.array([one.position for one in flexible.interfaces])
                shapes = np.array([one.Phi_t for one in flexible.interfaces])
            else:
                some = np.linspace(0, len(nodes.ids) - 1, min(_MAX_NODES, len(nodes.ids)))
                arms, shapes = (part[some.astype(int)] for part in (nodes.position, nodes.Phi_t))
            bent = own @ (shapes @ motion[k + 6 : k + 6 + body.m])
        turns = np.stack([skew(own @ arm) for arm in arms]) @ motion[k + 3 : k + 6]
        moves = np.sqrt(mass / len(arms)) * (motion[k : k + 3] + bent - turns)
        gyration = np.sqrt(np.trace(spread)) * motion[k + 3 : k + 6]
        parts.append(np.concatenate([moves, gyration[None]]))
    return np.concatenate(parts)
