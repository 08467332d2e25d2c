"""Three couplings at one wall, pressed, without friction: python tests/benchmarks/three_traces.py

Overwrites figures/three_traces.png beside this file. Hand, wall, encoder of 20 um, observer, estimator and adaptation
are those of the problem scenes/adaptive-press.
"""

from __future__ import annotations

from pathlib import Path

from script_arguments import script_arguments

from avc_casadi.design.methods import solve
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.present.figures.layout import save_figure
from avc_casadi.present.figures.scene import draw_traces

HERE = Path(__file__).parent


def main() -> None:
    problem = load_problem("scenes/adaptive-press")
    # The certified constant coupling has no contact damper.
    series = problem.coupling.model_copy(update={"structure": "series", "contact_damping_ns_per_m": (0.0, 0.0)})
    static = solve(problem.model_copy(update={"coupling": series}), "static")
    runs = {
        "no coupling": simulate(problem, NO_COUPLING),
        "static coupling": simulate(problem, static),
        "schedule": simulate(problem, solve(problem, "schedule")),
    }
    for name, run in runs.items():
        print(
            f"{name}: {run.claim}, {run.apparent_stiffness_n_per_m:.0f} N/m, {run.energy_generated_j:.2g} J generated"
        )
    save_figure(draw_traces(runs), HERE / "figures" / "three_traces.png")


if __name__ == "__main__":
    script_arguments(__doc__)
    main()
