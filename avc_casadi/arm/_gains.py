"""Stiffness and damping of the coupling by region of the workspace and by contact normal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from avc_casadi.arm._effective import unit
from avc_casadi.support import FloatArray, IndexArray


@dataclass(frozen=True)
class DirectedGains:
    """Spring K and damper D along a contact normal, K_t and D_t along the surface while a proxy holds the tip there.

    A place outside the workspace takes the gains of the nearest region, a normal those of the nearest direction; n and
    -n are the same.

    Attributes:
        low_m: lowest corner of the workspace, shape (d,).
        high_m: highest corner.
        regions: number of regions along each axis.
        directions: of length 1, shape (m, d).
        stiffness_n_per_m: K, shape (all regions, m), the last axis of the regions running first.
        damping_ns_per_m: D.
        tangent_stiffness_n_per_m: K_t, shape (all regions,).
        tangent_damping_ns_per_m: D_t.
    """

    low_m: FloatArray
    high_m: FloatArray
    regions: tuple[int, ...]
    directions: FloatArray
    stiffness_n_per_m: FloatArray
    damping_ns_per_m: FloatArray
    tangent_stiffness_n_per_m: FloatArray
    tangent_damping_ns_per_m: FloatArray

    def place(self, tip_m: FloatArray, normal: FloatArray) -> tuple[IndexArray, IndexArray]:
        """Return the region and the direction of places (p, d) and normals (p, d)."""
        counts = np.array(self.regions)
        share = (tip_m - self.low_m) / (self.high_m - self.low_m)
        cell = np.clip(np.floor(share * counts).astype(int), 0, counts - 1)
        region = np.ravel_multi_index(tuple(cell.T), self.regions)
        return np.asarray(region), np.argmax(np.abs(normal @ self.directions.T), axis=1)

    def at(self, tip_m: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return K with K_t and D with D_t at places (p, d) and normals (p, d), shape (2, p) each."""
        region, direction = self.place(tip_m, normal)
        stiffness = self.stiffness_n_per_m[region, direction], self.tangent_stiffness_n_per_m[region]
        damping = self.damping_ns_per_m[region, direction], self.tangent_damping_ns_per_m[region]
        return np.stack(stiffness), np.stack(damping)

    def times(self, factor: float) -> Self:
        """Return stiffness and damping so many times as large."""
        return replace(
            self,
            stiffness_n_per_m=self.stiffness_n_per_m * factor,
            damping_ns_per_m=self.damping_ns_per_m * factor,
            tangent_stiffness_n_per_m=self.tangent_stiffness_n_per_m * factor,
            tangent_damping_ns_per_m=self.tangent_damping_ns_per_m * factor,
        )

    def boxes(self) -> list[tuple[FloatArray, FloatArray]]:
        """Return the lowest and highest corner of each region."""
        size = (self.high_m - self.low_m) / np.array(self.regions)
        corners = [self.low_m + size * cell for cell in np.ndindex(*self.regions)]
        return [(corner, corner + size) for corner in corners]


def directions_of(axes: int, *, one: bool = False) -> FloatArray:
    """Return directions evenly about: towards faces, edges and corners of a cube, 13 in space and 4 in the plane.

    Args:
        axes: d.
        one: a single one, for which every normal is the nearest.
    """
    if one:
        return np.eye(axes)[:1]
    signs = np.array(list(np.ndindex(*(3,) * axes))) - 1
    first = np.array([next((value for value in row if value), 0) for row in signs])
    found = signs[first > 0]
    return unit(found[np.argsort(np.abs(found).sum(axis=1), kind="stable")].astype(np.float64))


def normals_near(directions: FloatArray, count: int) -> list[FloatArray]:
    """Return for each direction some normals that are nearest to it, itself among them, shape (some, d)."""
    drawn = unit(np.random.default_rng(0).standard_normal((count, directions.shape[1])))
    nearest = np.argmax(np.abs(drawn @ directions.T), axis=1)
    return [np.concatenate([directions[[k]], drawn[nearest == k]]) for k in range(len(directions))]
