"""Gains between rows: rows of which every gain that is meant is a mixture, so that a proof for these holds for it.

With the joint between coupling and wall for state (`stability.joint_rendering`) b and k enter the loop by

    1/total and b/total, total = b + k T + b_e + k_e T,

and b_p by itself: A is affine in these three. The map from (b, k) to the first two takes straight lines to straight
lines, since total is above 0, so a box of (b, k, b_p) goes into the convex hull of its 8 corners. A squared norm V
of the kind that proves L8 is convex in what comes out of A. So if every jump between corners shrinks, V_c(A_a x) <=
g V_a(x) with g < 1, then with A = sum l_a A_a, l_a >= 0 and sum l_a = 1, and any mixture V of the V_c

    V(A x) <= max over c of sum l_a V_c(A_a x) <= g sum l_a V_a(x)

The gains may then move about inside the box at any speed, from sample to sample, every one for
itself.
"""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray


def gain_corners(gains: FloatArray) -> FloatArray:
    """Return the corners of the box of some rows.

    Args:
        gains: b, k and b_p of the rows, shape (3, rows); infinite is rigid.

    Returns:
        Shape (3, n), n of 1 to 8.
    """
    ends = [np.unique([row.min(), row.max()]) for row in gains]
    return np.stack(np.meshgrid(*ends, indexing="ij")).reshape(3, -1)


def rows_and_between(gains: FloatArray) -> FloatArray:
    """Return rows whose mixtures hold every row and every straight way from one to the next.

    On the way b and k move by another share than b_p in the three numbers that count: between two rows that differ in
    both, coupling and contact damper are mixed crosswise too.

    Args:
        gains: b, k and b_p of the rows in the order of the table, shape (3, rows).

    Returns:
        Shape (3, n), the rows themselves first.
    """
    before, after = gains[:, :-1], gains[:, 1:]
    both = (before[:2] != after[:2]).any(axis=0) & (before[2] != after[2])
    crossed = [np.vstack([one[:2, both], other[2:, both]]) for one, other in ((before, after), (after, before))]
    return np.hstack([gains, *crossed])
