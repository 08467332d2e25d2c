"""Cones of one step of the program, solved with few of them at a time."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray

PER_LACK = 2.0
"""Weight of missing decay, in units of the squared error."""


class Cones:
    """Cones of the variables w, L = L_0 + W w, then gamma and the slack of decay."""

    def __init__(self, gain: FloatArray, axes: FloatArray) -> None:
        self._gain, self._axes = gain, axes
        self._blocks: list[tuple[object, FloatArray, FloatArray, bool]] = []

    def _rows(self, rows: FloatArray, constant: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.pad(rows @ self._axes, ((0, 0), (0, 2))), constant + rows @ self._gain

    def linear(self, key: object, rows: FloatArray, constant: FloatArray, *, lack: float = 0.0) -> None:
        """Require rows L + constant >= 0, with a slack."""
        matrix, level = self._rows(rows, constant)
        matrix[:, -1] = lack
        whole = isinstance(key, tuple) and key[0] == "pole"
        self._blocks.append((key, matrix[:, None], level[:, None], whole))

    def second(
        self, key: object, bound: tuple[FloatArray, FloatArray], rows: ComplexArray, constant: FloatArray
    ) -> None:
        """Require |rows L + constant| <= bound."""
        parts = self._rows(*bound), self._rows(rows.real, constant), self._rows(rows.imag, 0 * constant)
        matrix, level = (np.stack(part, axis=1) for part in zip(*parts, strict=True))
        self._blocks.append((key, matrix, level, False))

    def error(self, near: ComplexArray, near_0: ComplexArray, far: ComplexArray, far_0: ComplexArray) -> None:
        """Require |near|^2 <= gamma times the tangent of |far|^2."""
        value = far @ self._gain + far_0
        size = 1 / np.abs(value)
        turned = np.conj(value) * size**2
        half, half_0 = (turned[:, None] * far).real, (turned * far_0).real - 0.5
        over = size[:, None] * near, size * near_0
        parts = [
            self._rows(half, half_0),
            self._rows(-half, -half_0),
            self._rows(over[0].real, over[1].real),
            self._rows(over[0].imag, over[1].imag),
        ]
        matrix, level = (np.stack(part, axis=1) for part in zip(*parts, strict=True))
        matrix[:, :2, -2] = 0.5
        self._blocks.append(("error", matrix, level, True))

    def solved(self, near: dict[object, BoolArray]) -> FloatArray:
        """Minimise gamma and the slack: a few of the cones, then those that the solution violates, until none is."""
        import clarabel  # noqa: PLC0415
        from scipy import sparse  # noqa: PLC0415

        n = self._axes.shape[1] + 2
        positive = np.eye(n)[-1:]
        blocks = [*self._blocks, ("slack", positive[:, None], np.zeros((1, 1)), True)]
        masks = [_mask(near.get(key), len(level), whole=whole) for key, _, level, whole in blocks]
        cost = np.zeros(n)
        cost[-2:] = 1.0, PER_LACK
        quadratic = sparse.diags(np.append(np.full(n - 2, 1e-6), np.zeros(2))).tocsc()
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_iter = False, 60
        settings.tol_gap_abs, settings.tol_gap_rel, settings.tol_feas = 1e-6, 1e-4, 1e-7
        for _ in range(6):
            some = [(matrix[mask], level[mask]) for (_, matrix, level, _), mask in zip(blocks, masks, strict=True)]
            some.sort(key=lambda one: one[0].shape[1] > 1)
            linear = sum(len(level) for _, level in some if level.shape[1] == 1)
            kinds = [clarabel.NonnegativeConeT(linear)]
            for _, level in some:
                if level.shape[1] > 1:
                    kinds += [clarabel.SecondOrderConeT(level.shape[1])] * len(level)
            rows = sparse.csc_matrix(-np.concatenate([matrix.reshape(-1, n) for matrix, _ in some]))
            right = np.concatenate([level.ravel() for _, level in some])
            solution = np.array(clarabel.DefaultSolver(quadratic, cost, rows, right, kinds, settings).solve().x)
            values = [matrix @ solution + level for _, matrix, level, _ in blocks]
            gaps = [value[:, 0] - np.linalg.norm(value[:, 1:], axis=1) for value in values]
            violated = [(gap < -1e-5) & ~mask for gap, mask in zip(gaps, masks, strict=True)]
            if not any(map(np.any, violated)):
                break
            masks = [mask | more for mask, more in zip(masks, violated, strict=True)]
        for (key, *_), gap, mask in zip(blocks, gaps, masks, strict=True):
            near[key] = mask & (gap < 0.15 * max(1e-9, float(np.median(gap))))
        return np.asarray(self._gain + self._axes @ solution[:-2])


def _mask(near: BoolArray | None, count: int, *, whole: bool) -> BoolArray:
    """Return the cones of a block to begin with: those near the last time, and every fortieth."""
    mask = np.full(count, whole) if near is None or len(near) != count else near | whole
    mask[::40] = True
    return mask
