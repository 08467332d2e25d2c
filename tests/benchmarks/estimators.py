"""Table and figure of the frequency estimators: python tests/benchmarks/estimators.py

Overwrites RESULTS_estimators.md and figures/estimators.png beside this file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from script_arguments import script_arguments
from studies.estimators.figure import draw_estimators
from studies.estimators.study import EstimatorRow, study_estimators, trace_estimators

from avc_casadi.present.figures.style import save_figure

HERE = Path(__file__).parent

COLUMNS = (
    ("estimator", lambda row: row.method),
    ("states", lambda row: f"{row.states}"),
    ("instructions", lambda row: f"{row.instructions}"),
    ("3 to 12 Hz, s", lambda row: f"{row.settling_up_s:.3f}"),
    ("12 to 3 Hz, s", lambda row: f"{row.settling_down_s:.3f}"),
    ("first, s", lambda row: f"{row.first_s:.3f}"),
    ("rest, s", lambda row: f"{row.rest_s:.3f}"),
    ("bias 1-50 Hz", lambda row: f"{np.abs(row.bias).max():.2%}"),
    ("noise", lambda row: f"{row.noise:.2%}"),
    ("bound", lambda row: f"{row.bound:.3%}"),
    ("drift", lambda row: f"{row.drift:.1%}"),
    ("harmonic", lambda row: f"{row.harmonic:.1%}"),
    ("encoder", lambda row: f"{row.encoder:.1%}"),
    ("valid at rest", lambda row: f"{row.valid_at_rest:.0%}"),
)


def table(rows: tuple[EstimatorRow, ...]) -> str:
    lines = [" | ".join(name for name, _ in COLUMNS), " | ".join("---" for _ in COLUMNS)]
    lines += [" | ".join(text(row) for _, text in COLUMNS) for row in rows]
    return "\n".join(f"| {line} |" for line in lines)


def main() -> None:
    text = f"""# Estimators of the interaction frequency

Made by `python tests/benchmarks/estimators.py`. T = 1 ms, a tone of 1 mm, backward difference of the position; the
worst of six phases, errors as shares of the true frequency.

{table(study_estimators())}

- 3 to 12 Hz, 12 to 3 Hz: until the error stays below 10 %. First: from rest to the first valid estimate at 3 Hz.
  Rest: from the end of the motion until the estimate is undefined.
- Bias: largest of nine tones, 1 to 50 Hz. Noise: standard deviation with 10 um rms of white noise on the position at
  3 Hz; bound: the Cramer-Rao bound for a window as long as the settling time (12 to 3 Hz).
- Drift: largest error beside 5 mm at 0.3 Hz. Harmonic: with 30 % third harmonic in the position, which is 90 % in the
  velocity. Encoder: steps of 20 um. Valid at rest: share of valid estimates at rest with a count that flickers.

![estimates over time](figures/estimators.png)
"""
    (HERE / "RESULTS_estimators.md").write_text(text, encoding="utf-8")
    print(text)
    save_figure(draw_estimators(trace_estimators()), HERE / "figures" / "estimators.png")


if __name__ == "__main__":
    script_arguments(__doc__)
    main()
