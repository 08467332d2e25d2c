"""Joint spectral radius: the largest growth rate of products of some matrices, in any order; bounded from both sides.

Below by the spectral radius of a product, whose order is the witness. Above by branch and bound after Gripenberg: a
product is extended only while every prefix of it grows faster, by its norm, than the lower bound. The norm is that of
an ellipsoid which all matrices contract, or stretch least, among weighted means of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.claims.stability.switching import lyapunov

# A norm or an eigenvalue of these matrices is right to about 1e-12.
_ROUNDING = 1e-10
_SWEEPS = 60
# The members' own functions decrease by this share of the way from the largest radius to no decrease.
_SHARES = (1.0005, 1.002, 1.01, 1.05)


@dataclass(frozen=True)
class JointRadius:
    """Bounds of a joint spectral radius, each a factor by one matrix.

    Attributes:
        low: growth of the pattern.
        high: bound for any order.
        pattern: indices of the matrices in the order in which they act; repeated, it grows by `low` a matrix.
        products: number of evaluated products.
    """

    low: float
    high: float
    pattern: tuple[int, ...]
    products: int


def product_of(matrices: FloatArray, pattern: tuple[int, ...]) -> FloatArray:
    """Multiply matrices, shape (m, s, s), so that the first of the pattern acts first."""
    found = np.eye(matrices.shape[-1])
    for number in pattern:
        found = matrices[number] @ found
    return found


def growth(matrices: FloatArray, pattern: tuple[int, ...]) -> float:
    """Return the growth factor of a repeated pattern, per matrix."""
    radius = np.abs(np.linalg.eigvals(product_of(matrices, pattern))).max()
    return float(radius ** (1 / len(pattern)))


def joint_spectral_radius(
    matrices: FloatArray,
    follows: BoolArray | None = None,
    *,
    accuracy: float = 5e-4,
    longest: int = 24,
    most_products: int = 3_000,
) -> JointRadius:
    """Bound the joint spectral radius of real matrices.

    Args:
        matrices: shape (m, s, s), finite.
        follows: shape (m, m): whether the second may act after the first; None lets them act in any order.
        accuracy: sufficient distance of the bounds.
        longest: most matrices in a product.
        most_products: largest number held at a time; beyond it the search for a pattern continues with the largest of
            them and the upper bound stays.

    Returns:
        Bounds and the pattern that reaches the lower one.
    """
    count, size, _ = matrices.shape
    after = np.ones((count, count), dtype=bool) if follows is None else follows
    root = ellipsoid(matrices)
    normed = root @ matrices @ np.linalg.inv(root)
    products: FloatArray = np.broadcast_to(np.eye(size), (count, size, size))
    words: IndexArray = np.zeros((count, 0), dtype=np.intp)
    parents, last = np.arange(count), np.arange(count)
    reach = np.full(count, np.inf)
    pattern: tuple[int, ...] = (0,)
    low, high, looked_at, whole = -1.0, np.inf, 0, True
    for length in range(1, longest + 1):
        if length > 1:
            parents, last = np.nonzero(after[words[:, -1]])
        products = normed[last] @ products[parents]
        words = np.concatenate([words[parents], last[:, None]], axis=1)
        norm = np.linalg.norm(products, 2, axis=(1, 2)) ** (1 / length) * (1 + _ROUNDING)
        reach = np.minimum(reach[parents], norm)
        looked_at += len(words)
        hopeful = np.flatnonzero((norm > low) & after[words[:, -1], words[:, 0]])
        if hopeful.size:
            radius = np.abs(np.linalg.eigvals(products[hopeful])).max(axis=1) ** (1 / length)
            best = int(np.argmax(radius))
            if radius[best] > low * (1 + _ROUNDING):
                low, pattern = float(radius[best]), tuple(int(one) for one in words[hopeful[best]])
        if whole:
            high = min(high, max(low + accuracy, float(reach.max())))
        kept = np.flatnonzero(reach > low + accuracy)
        if kept.size == 0:
            break
        if len(words) > most_products:
            whole = False
            kept = kept[np.argsort(norm[kept])[-max(1, most_products * len(kept) // (len(words) * count)) :]]
        products, words, reach = products[kept], words[kept], reach[kept]
    pattern = _shortest(pattern)
    return JointRadius(growth(matrices, pattern), float(high), pattern, looked_at)


def _shortest(pattern: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shortest word of which a pattern is a repetition, in its smallest rotation."""
    for size in range(1, len(pattern) + 1):
        if len(pattern) % size == 0 and pattern[:size] * (len(pattern) // size) == pattern:
            return min(pattern[turn:size] + pattern[:turn] for turn in range(size))
    return pattern


def ellipsoid(matrices: FloatArray, sweeps: int = _SWEEPS) -> FloatArray:
    """Return R, shape (s, s), of a norm |R x| that matrices, shape (m, s, s), stretch little; less with more sweeps."""
    size = matrices.shape[-1]
    largest = max(float(np.abs(np.linalg.eigvals(matrices)).max()), 1e-12)
    best, least = np.eye(size), _stretch(np.eye(size), matrices).max()
    for share in _SHARES:
        own = lyapunov(matrices / (share * largest), np.broadcast_to(np.eye(size), matrices.shape))
        if not np.isfinite(own).all():
            continue
        own = own / np.trace(own, axis1=1, axis2=2)[:, None, None]
        weight = np.full(len(own), 1.0 / len(own))
        for _ in range(sweeps):
            root = _root(np.einsum("m,mij->ij", weight, own))
            stretch = _stretch(root, matrices)
            if stretch.max() < least:
                best, least = root, stretch.max()
            spread = max(float(stretch.max() - stretch.min()), 1e-300)
            weight = weight * (1 + 0.5 * (stretch - stretch.min()) / spread)
            weight /= weight.sum()
    return best


def _root(square: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(square)
    return np.asarray(np.sqrt(np.maximum(values, 1e-14 * values[-1]))[:, None] * vectors.T)


def _stretch(root: FloatArray, matrices: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(root @ matrices @ np.linalg.inv(root), 2, axis=(1, 2)))
