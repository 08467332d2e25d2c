"""Gains for every contact normal in every region: designed along one axis, checked in the coupled loop.

Along each direction the device is one of one axis whose mass is that of the region and of all normals near the
direction, its tangent free to held. Its stiffest wall with every hand and released, at every corner of the ranges, lies
at the tip of a wedge of stiffness and damping; the gains are a share of that tip. Along the surface they are those for
any direction. Then all are softened, if necessary, until the coupled loop has the reserve.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.arm.coupled import CoupledCertificate, coupled_certificate
from avc_casadi.arm.effective_mass import mass_range, tip_device, unit
from avc_casadi.claims.stability.stiffest_wall import stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released

if TYPE_CHECKING:
    from avc_casadi.arm.arm import Arm


@dataclass(frozen=True)
class DirectedGains:
    """Spring K and damper D along a contact normal, K_t and D_t along the surface while a proxy holds the tip there.

    A position outside the workspace takes the gains of the nearest region, a normal those of the nearest direction; n
    and -n are equivalent.

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
        """Return the region and the direction of positions (p, d) and normals (p, d)."""
        counts = np.array(self.regions)
        share = (tip_m - self.low_m) / (self.high_m - self.low_m)
        cell = np.clip(np.floor(share * counts).astype(int), 0, counts - 1)
        region = np.ravel_multi_index(tuple(cell.T), self.regions)
        return np.asarray(region), np.argmax(np.abs(normal @ self.directions.T), axis=1)

    def at(self, tip_m: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return K with K_t and D with D_t at positions (p, d) and normals (p, d), shape (2, p) each."""
        region, direction = self.place(tip_m, normal)
        stiffness = self.stiffness_n_per_m[region, direction], self.tangent_stiffness_n_per_m[region]
        damping = self.damping_ns_per_m[region, direction], self.tangent_damping_ns_per_m[region]
        return np.stack(stiffness), np.stack(damping)

    def times(self, factor: float) -> Self:
        """Return stiffness and damping scaled by a factor."""
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
    """Return evenly spaced directions: towards faces, edges and corners of a cube, 13 in space and 4 in the plane.

    Args:
        axes: d.
        one: a single one, nearest to every normal.
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


SHARE = 0.8
"""Share of the stiffest wall along one axis."""
RESERVE = 1.1
"""Factor of all gains up to which the coupled loop is found stable."""
_NORMALS = 400
_PER_AXIS = 5
_ROUNDS = 3
# Allowance for a smaller factor found by the search at softer gains.
_SLACK = 1.01


@dataclass(frozen=True)
class ArmDesign:
    """Gains of an arm with the intermediate results of their design.

    Attributes:
        gains: the gains.
        per_axis: the same before the check of the coupled loop.
        per_axis_factor: margin of the coupled loop with these.
        lightest_kg: along each direction in each region, shape as the stiffness.
        heaviest_kg: along each direction.
        certificate: of the gains.
    """

    gains: DirectedGains
    per_axis: DirectedGains
    per_axis_factor: float
    lightest_kg: FloatArray
    heaviest_kg: FloatArray
    certificate: CoupledCertificate


def design_arm(
    arm: Arm,
    regions: tuple[int, ...] | None = None,
    *,
    one: bool = False,
    points: int = 3000,
    seed: int = 0,
    progress: Progress = SILENT,
) -> ArmDesign:
    """Design the gains of an arm.

    Args:
        arm: workspace, device with its ranges, hands.
        regions: parts of the workspace along each axis; None is one.
        one: one coupling for all normals in place of one for each direction.
        points: drawn for each corner of the device by the coupled certificate.
        seed: of the draws.
        progress: reported over the directions and corners.

    Raises:
        InputError: a region that the mechanism does not reach, or a singular one.
        UnsupportedError: the device has a resonance, or no gains keep the reserve.
    """
    directions = directions_of(len(arm.axes), one=one)
    near = [None] if one else normals_near(directions, _NORMALS)
    low, high = arm.box_m
    shape = (1,) * len(arm.axes) if regions is None else regions
    cells = int(np.prod(shape))
    empty = np.zeros((cells, len(directions)))
    start = DirectedGains(low, high, shape, directions, empty, empty, np.zeros(cells), np.zeros(cells))
    subjects = with_released(hand_corners(arm.file.hands))
    lightest, heaviest, stiffness, damping = (np.zeros((cells, len(near) + 1)) for _ in range(4))
    for region, box in enumerate(start.boxes()):
        for column, normals in enumerate([*near, None]):
            if one and column:
                masses = lightest[region, 0], heaviest[region, 0]
            else:
                found = mass_range(arm, normals, box, _PER_AXIS)
                masses = found.lightest_kg, found.heaviest_kg
            lightest[region, column], heaviest[region, column] = masses
            wall = stiffest_wall(tip_device(arm, *masses), subjects)
            stiffness[region, column] = SHARE * wall.stiffness_n_per_m
            damping[region, column] = SHARE * (wall.lowest_ns_per_m + wall.highest_ns_per_m) / 2
            progress.advance(region * (len(near) + 1) + column + 1, cells * (len(near) + 1), "directions")
    per_axis = DirectedGains(
        low, high, shape, directions, stiffness[:, :-1], damping[:, :-1], stiffness[:, -1], damping[:, -1]
    )
    certificate = coupled_certificate(arm, per_axis, points=points, seed=seed, progress=progress)
    gains, alone = per_axis, certificate.worst.factor
    for _ in range(_ROUNDS):
        if certificate.stable and certificate.worst.factor >= RESERVE:
            return ArmDesign(gains, per_axis, alone, lightest[:, :-1], heaviest[:, :-1], certificate)
        gains = gains.times(min(1.0, certificate.worst.factor / (RESERVE * _SLACK)))
        certificate = coupled_certificate(arm, gains, points=points, seed=seed, progress=progress)
    raise UnsupportedError(
        f"no gains with a reserve of {RESERVE:g} were found in the coupled loop: it ends at a factor of "
        f"{certificate.worst.factor:.3g}; give more damping or a smaller workspace",
        key="workspace",
    )


SCHEMA = "avc-arm-gains/1"
_DIGITS = 6


def gains_document(arm: Arm, design: ArmDesign) -> dict[str, Any]:
    """Return the gains with their claims, as JSON values."""
    gains, certificate = design.gains, design.certificate
    regions = [
        {
            "low_m": low,
            "high_m": high,
            "tangent_stiffness_n_per_m": gains.tangent_stiffness_n_per_m[index],
            "tangent_damping_ns_per_m": gains.tangent_damping_ns_per_m[index],
            "stiffness_n_per_m": gains.stiffness_n_per_m[index],
            "damping_ns_per_m": gains.damping_ns_per_m[index],
            "lightest_kg": design.lightest_kg[index],
            "heaviest_kg": design.heaviest_kg[index],
        }
        for index, (low, high) in enumerate(gains.boxes())
    ]
    document: dict[str, Any] = _rounded(
        plain(
            {
                "schema": SCHEMA,
                "arm": arm.file.name,
                "axes": list(arm.axes),
                "sample_time_s": arm.file.device.sample_time_s,
                "max_force_n": arm.file.device.max_force_n,
                "home_tip_m": arm.home_tip_m,
                "low_m": gains.low_m,
                "high_m": gains.high_m,
                "region_counts": list(gains.regions),
                "directions": gains.directions,
                "regions": regions,
                "claim": {
                    "sentence": (
                        "the frozen loop in space is stable with every pose, normal, hand and corner of the device "
                        "that a search looked at, up to this factor of all gains; found by a search, not proved"
                    ),
                    "stable": certificate.stable,
                    "factor": certificate.worst.factor,
                    "reserve": RESERVE,
                    "share_of_the_stiffest_wall_along_one_axis": SHARE,
                    "factor_of_one_axis_designs": design.per_axis_factor,
                    "drawn": certificate.looked_at,
                    "worst": certificate.worst.document(),
                },
            }
        )
    )
    return document


def gains_toml(document: Mapping[str, Any]) -> str:
    """Return `gains_document` as TOML."""
    plain_keys = {key: value for key, value in document.items() if key not in {"regions", "claim"}}
    claim = {key: value for key, value in document["claim"].items() if key != "worst"}
    worst = _lines(document["claim"]["worst"])
    lines = [*_lines(plain_keys), "", "[claim]", *_lines(claim), "", "[claim.worst]", *worst]
    for region in document["regions"]:
        lines += ["", "[[regions]]", *_lines(region)]
    return "\n".join(lines) + "\n"


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in table.items() if value is not None]


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
