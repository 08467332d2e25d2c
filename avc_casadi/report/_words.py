"""What the figures of a comparison show, in a sentence with numbers each: for who cannot see them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.support import counts_text, number

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from avc_casadi.study.comparison import Comparison


def picture_words(comparison: Comparison) -> Mapping[str, str]:
    """Return a sentence for each of the figures boundaries, perceived and comparison.

    Args:
        comparison: what they draw.
    """
    band = f"from {_span(comparison.frequency_hz)} Hz"
    desired = np.abs(comparison.target)
    gains, closed = comparison.methods[comparison.delivered], comparison.methods["closed-form"]
    with np.errstate(divide="ignore", invalid="ignore"):
        upper, lower, bare = (
            100 * np.abs(curve) / desired for curve in (comparison.upper, comparison.lower, comparison.without_coupling)
        )
        error, closed_error = (100 * one.magnitude_error / desired for one in (gains, closed))
    return {
        "boundaries": (
            f"Two charts {band}. The desired |Z_h| runs from {_span(desired)} N.s/m. Relative to it the upper bound "
            f"lies at {_span(upper)} %, the lower at {_span(lower)} %, the wall without coupling at {_span(bare)} %."
        ),
        "perceived": (
            f"Charts {band} of {comparison.delivered} beside the closed form. |Z_h| of {comparison.delivered} errs by "
            f"{_most(error)} % of the desired at most; b lies within {_span(gains.damping_ns_per_m)} N.s/m, k within "
            f"{_span(gains.stiffness_n_per_m)} N/m. Re Z_h is {_least(gains.real_part)} N.s/m at least; without "
            f"coupling {_least(np.real(comparison.without_coupling))}."
        ),
        "comparison": (
            f"Errors {band}: {comparison.delivered} misses |Z_h| by at most {_most(error)} % and the complex impedance "
            f"by {_most(100 * gains.complex_error)} %; the closed form, of which {int(closed.usable.sum())} of "
            f"{closed.rows} rows can be built, by {_most(closed_error)} %. Verdicts: "
            f"{counts_text(comparison.counts())}."
        ),
    }


def _known(values: ArrayLike) -> list[float]:
    array = np.asarray(values, dtype=float)
    return [float(value) for value in array[np.isfinite(array)]]


def _span(values: ArrayLike) -> str:
    known = _known(values)
    return f"{number(min(known), 3)} to {number(max(known), 3)}" if known else "nothing known"


def _most(values: ArrayLike) -> str:
    return number(max(_known(values), default=float("nan")), 3)


def _least(values: ArrayLike) -> str:
    return number(min(_known(values), default=float("nan")), 3)
