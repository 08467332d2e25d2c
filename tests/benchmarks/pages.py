"""Pages as a user sees them: `avc explore` and the report of `avc run` on a laptop and a phone, with their times.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/pages.py

Overwrites results/pages.json, RESULTS_pages.md and figures/page_*.png; five minutes on two cores, with Chromium and
its driver. A time is that of the wall clock in the browser, and counts from the request of the page or the move of a
slider. Cold: the server has just started, and answers the page alone; warm: it has answered its opening questions.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image
from studied import about, computed, made_by, table

import avc_casadi as avc
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.server import ExploreServer, warm

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "oracle"))
from browser import SIZES, chromium, sized, until  # noqa: E402 - the browser of the tests

OUT = HERE / "results" / "pages.json"
PAGE = HERE / "RESULTS_pages.md"
FIGURES = HERE / "figures"
COLOURS = 128
"""Colours of a picture of a page, which keeps its file small."""
FOLLOWER = """
[device]
mass_kg = 0.12
damping_ns_per_m = 0.8
delay_samples = 1
max_force_n = 8.0

[follower]
mass_kg = 0.3
damping_ns_per_m = 1.0
delay_samples = 1
delay_s = 0.005
"""
PROBLEMS = {
    "figure5": "Wall: stiffness",
    "reference-r1": "Wall: stiffness",
    "knob": "Wall: stiffness",
    "tool/mujoco-500hz": "Simulation: tool mass, least",
    "follower": "Follower: delay",
}
"""Problems, each with a slider of its own next to that of the spring."""
PICTURED = {"explore": "reference-r1", "simulation": "tool/mujoco-500hz"}
"""Problems of the pictures, by the names of their files."""

# Times, ms since the request of the page, at which the first picture and the first verdict of one's own law are there.
_WATCH = """
window.seen = {};
new MutationObserver(() => {
  const verdict = document.querySelector(".verdict.own:not(.stale)");
  if (document.querySelector("#charts svg")) window.seen.picture ??= performance.now();
  if (verdict) window.seen.verdict ??= performance.now();
}).observe(document, { childList: true, subtree: true, attributes: true });
"""
# Moves a slider and returns the times, ms, after which a picture and the verdict of one's own law are those of it.
_MOVE = """
const [name, share, done] = arguments, slider = document.querySelector(`[aria-label='${name}']`);
const begun = performance.now(), seen = {};
slider.value = share * slider.max;
slider.dispatchEvent(new Event("input", { bubbles: true }));
const look = () => {
  if (!document.querySelector("figure.stale")) seen.all ??= performance.now() - begun;
  if (document.querySelector("figure:not(.stale)")) seen.picture ??= performance.now() - begun;
  if (document.querySelector(".verdict.own:not(.stale)")) seen.verdict ??= performance.now() - begun;
  if (seen.all && seen.picture && seen.verdict) done(seen);
  else requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""
_ANSWERED = "return !document.querySelector('main').classList.contains('behind')"
_SETTLED = """
return document.getElementById("status").textContent === "ready" && document.getElementById("cancel").hidden
  && !document.querySelector("main").classList.contains("behind") && document.querySelector("#rows td.method > div");
"""


@contextmanager
def served(name: str) -> Iterator[ExploreServer]:
    """Serve a problem of the catalogue, or the follower."""
    if name == "follower":
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "follower.toml"
            file.write_text(FOLLOWER, encoding="utf-8")
            problem = avc.load_problem(file)
    else:
        problem = avc.load_problem(name)
    with ExploreServer(Explorer(problem, name)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.explorer.close()
        server.shutdown()


def opened(driver: Any, server: ExploreServer) -> dict[str, float]:
    """Open the page and return when its first picture and verdict were there, s."""
    driver.get("about:blank")
    driver.get(server.url)
    until(lambda: driver.execute_script("return window.seen?.picture && window.seen?.verdict"))
    seen = driver.execute_script("return window.seen")
    return {f"{name}_s": round(ms / 1e3, 3) for name, ms in seen.items()}


def explored(name: str) -> dict[str, Any]:
    """Open the page of a problem cold and warm, move two sliders, and keep its pictures."""
    found: dict[str, Any] = {"load": round(os.getloadavg()[0], 1)}
    with tempfile.TemporaryDirectory() as folder, chromium(folder) as driver:
        driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": _WATCH})
        sized(driver, "laptop")
        with served(name) as server:
            found["cold"] = opened(driver, server)
            # Its last answers would take the processor of the warm server.
            until(lambda: driver.execute_script(_ANSWERED), 600)
        with served(name) as server:
            warm(server.explorer)
            found["warm"] = opened(driver, server)
            until(lambda: driver.execute_script(_SETTLED), 600)
            spring = driver.execute_script(
                "return document.querySelector('#gains input[type=range]').getAttribute('aria-label')"
            )
            for label, slider in (("spring", spring), ("other", PROBLEMS[name])):
                moved = driver.execute_async_script(_MOVE, slider, 0.45)
                found[label] = {"slider": slider} | {f"{part}_s": round(ms / 1e3, 3) for part, ms in moved.items()}
            for title in (title for title, pictured in PICTURED.items() if pictured == name):
                for size in SIZES:
                    sized(driver, size)
                    opened(driver, server)
                    until(lambda: driver.execute_script(_SETTLED), 600)
                    keep(driver, f"page_{title}_{size}")
    return found


def keep(driver: Any, name: str) -> None:
    """Keep what the window shows as a small picture."""
    picture = Image.open(BytesIO(driver.get_screenshot_as_png())).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(FIGURES / f"{name}.png", optimize=True)


def reported(name: str) -> dict[str, Any]:
    """Run `avc run` and keep pictures of its report."""
    with tempfile.TemporaryDirectory() as folder, chromium(folder) as driver:
        command = [sys.executable, "-m", "avc_casadi", "run", name, "--out", f"{folder}/run"]
        subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - a command of this package
        file = Path(folder) / "run" / "report.html"
        for size, (width, height) in SIZES.items():
            sized(driver, size, 2 * height if width < height else height + height // 4)
            driver.get(file.as_uri())
            keep(driver, f"page_report_{size}")
        return {"report_kb": round(file.stat().st_size / 1e3)}


TEXT = """# Pages as a user sees them

{made_by} The load of the machine was {load}.

`avc explore` and the report of `avc run` in Chromium, on a laptop of 1366 x 768 and a phone of 390 x 844 pixels. Wall
clock in the browser, s: from the request of the page to the first picture and the first verdict on your own law, and
from the move of a slider to its picture and its verdict. *Cold*: the server has just started. *Warm*: it has answered
the questions with which a page opens, as it does by itself within seconds of its start.

{rows}

What limits them: a cold server loads modules and searches a first spring and damper; the first picture waits for
neither. A verdict after a slider is the stability and the margins of your own law over all hands: 0.2 s of processor
time on a rigid device, 0.3 s on a device with a resonance (reference-r1), 0.5 s with an engine, 1.5 s with a follower.
Which k and b are stable follows it. The recommended coupling is a run of its own, of 10 to 60 s of processor time.

## avc explore

![reference-r1 on a laptop](figures/page_explore_laptop.png)

![reference-r1 on a phone](figures/page_explore_phone.png) ![a simulation on a phone](figures/page_simulation_phone.png)

![a simulation on a laptop](figures/page_simulation_laptop.png)

## The report of avc run

![the report on a laptop](figures/page_report_laptop.png)

![the report on a phone](figures/page_report_phone.png)
"""


def write_page(document: dict[str, Any]) -> None:
    """Write the page of results."""
    cells = {name: cell for name, cell in document["cells"].items() if "warm" in cell}
    head = ("problem", "cold: picture, verdict", "warm: picture, verdict", "spring moves: picture, verdict", "another")
    rows = [
        (name, _times(cell["cold"]), _times(cell["warm"]), _times(cell["spring"]), _times(cell["other"]))
        for name, cell in cells.items()
    ]
    loads = [cell["load"] for cell in cells.values()]
    load = f"{min(loads, default=0.0):g} to {max(loads, default=0.0):g} on {os.cpu_count()} processors"
    text = TEXT.format(made_by=made_by(document["about"]), load=load, rows=table(head, rows))
    PAGE.write_text(text, encoding="utf-8")


def _times(cell: Mapping[str, Any]) -> str:
    slider = f" ({cell['slider'].partition(': ')[2]})" if "slider" in cell else ""
    return f"{cell['picture_s']:.2f}, {cell['verdict_s']:.2f}{slider}"


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    OUT.unlink(missing_ok=True)
    command = "OPENBLAS_NUM_THREADS=1 python tests/benchmarks/pages.py"
    cells = {name: partial(explored, name) for name in PROBLEMS} | {"report": partial(reported, "reference-r1")}
    computed(cells, OUT, about(command, 0), write_page)


if __name__ == "__main__":
    main()
