"""The picture of the README: a hand presses figure 5's stiff wall through four couplings.

python tests/benchmarks/wall_pressed.py

Overwrites figures/wall_pressed.png beside this file, and prints what each renders.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from script_arguments import script_arguments

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.recommendation.rendered import frequency_sweep

if TYPE_CHECKING:
    from avc_casadi.model.gains import Gains

FIGURE = Path(__file__).parent / "figures" / "wall_pressed.png"
DURATION_S = 1.0
FREQUENCY_HZ = np.geomspace(1.0, 100.0, 100)
COLOURS = {"no coupling": "#b0b0b0", "static": "#7a9cc6", "adaptive": "#e1903e", "recommended": "#2a8f5c"}


def couplings(problem: avc.Problem) -> dict[str, Coupling | Gains]:
    """Return none, the best passive constant coupling, the best schedule for all hands, and the recommended one."""
    adaptive = problem.changed(stability={"model": "sampled-data", "scope": "hands"})
    recommended = avc.recommend(problem).coupling
    assert isinstance(recommended, Coupling)
    return {
        "no coupling": NO_COUPLING,
        "static": Coupling.from_schedule(problem, avc.solve(problem, "static")),
        "adaptive": Coupling.from_schedule(adaptive, avc.solve(adaptive, "schedule")),
        "recommended": recommended,
    }


def main() -> None:
    script_arguments(__doc__)
    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415 - after the backend is chosen

    problem = avc.load_problem("figure5").changed(scene={"duration_s": DURATION_S})
    wall = problem.environment.stiffness_n_per_m
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.6), layout="constrained")
    for name, coupling in couplings(problem).items():
        run = avc.simulate(problem, coupling)
        print(f"{name}: {run.claim}, {run.apparent_stiffness_n_per_m:.4g} N/m at the end of the press")
        left.plot(run.time_s, 1e3 * run.position_m, color=COLOURS[name], label=name, lw=1.6)
        if isinstance(coupling, Coupling):
            found = frequency_sweep(coupling, coupling.static_stiffness_n_per_m, FREQUENCY_HZ)
            right.loglog(found.frequency_hz, found.stiffness_n_per_m / 1e3, color=COLOURS[name], lw=1.8)
    left.axhline(0.0, color="0.3", lw=0.8, ls=":")
    left.set(xlabel="time (s)", ylabel="depth in the wall (mm)", xlim=(0.12, 0.6), ylim=(-0.8, 0.8))
    left.set_title("a hand presses a wall of 100 kN/m", fontsize=10)
    left.legend(fontsize=8, loc="lower right")
    right.axhline(wall / 1e3, color="0.3", lw=1.0, ls="--")
    right.text(FREQUENCY_HZ[0], 1.08 * wall / 1e3, "the wall itself", fontsize=8, color="0.3")
    right.set(xlabel="frequency of the hand (Hz)", ylabel="rendered stiffness (kN/m)", ylim=(3.0, 300.0))
    right.set_title("how stiff it feels", fontsize=10)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    figure.savefig(FIGURE, dpi=130)


if __name__ == "__main__":
    main()
