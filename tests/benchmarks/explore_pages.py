"""How fast the page of `avc explore` follows, and its memory: python -m tests.benchmarks.explore_pages.

A script moves a slider in headless Chromium as a hand does: a change every 50 ms for 5 s, or one change after
the other with a rest between. The times are the page's own, from the event of the input to the frame after the picture.
Memory is that of the server's process while the slider goes to and fro without a rest. Overwrites explore.json in
results and RESULTS_explore.md; with --pictures the screenshots in figures instead.
"""

import argparse
import io
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))

from browser import WIDTHS, chromium, resize, screenshot

import avc_casadi as avc
from avc_casadi.explore import PARTS, Explorer, ExploreServer
from avc_casadi.explore._answers import answer

HERE = Path(__file__).parent
CASES = {"figure5, 200 frequencies": {}, "1000 frequencies": {"points": 1000}}
COMMAND = "python -m tests.benchmarks.explore_pages"
_SHOWN = {"picture": "impedance and gains", "judge": "certificate, verdict, stiffest wall", "touch": "simulated touch"}
_DRAG = """
const [every, count, rest, done] = arguments;
const slider = document.querySelector("[aria-label='Wall: stiffness']");
performance.clearMeasures();
let moved = 0;
window.movedBefore ??= 0;
const move = () => {
  slider.value = 300 + (window.movedBefore * 37) % 600;
  window.movedBefore += 1;
  slider.dispatchEvent(new Event("input", { bubbles: true }));
  moved += 1;
  if (moved < count) setTimeout(move, every);
  else setTimeout(() => done(Object.fromEntries(["picture", "judge", "touch"].map((what) =>
    [what, performance.getEntriesByName(what).map((one) => one.duration)]))), rest);
};
move();
"""
_MEASURED = """return Object.fromEntries(["picture", "judge", "touch"].map((what) =>
  [what, performance.getEntriesByName(what).map((one) => one.duration)]))"""
_WORK = {
    "impedance and gains": ("now",),
    "certificate, verdict, stiffest wall": ("judge",),
    "simulated touch": ("touch",),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--minutes", type=float, default=5.0, help="how long the slider moves for the memory; default 5"
    )
    parser.add_argument("--changes", type=int, default=20, help="changes waited for at rest; default 20")
    parser.add_argument("--pictures", action="store_true", help="take the screenshots only")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, chromium(Path(folder)) as driver:
        if args.pictures:
            pictures(driver, Path(folder))
            return
        driver.set_script_timeout(600)
        cases = {name: latency(driver, changes, args.changes) for name, changes in CASES.items()}
        found = {
            "command": f"{COMMAND} --changes {args.changes} --minutes {args.minutes:g}",
            "version": avc.__version__,
            "load": os.getloadavg(),
            "cases": cases,
            "memory": memory(driver, args.minutes),
        }
    (HERE / "results" / "explore.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (HERE / "RESULTS_explore.md").write_text(page(found), encoding="utf-8")
    print(page(found))


def serving(changes):
    problem = avc.load_problem("figure5").changed(frequency=changes)
    server = ExploreServer(Explorer(problem, "figure5"))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


def opened(driver, url):
    driver.get("about:blank")
    driver.get(url)
    while not driver.find_elements("css selector", "#c-region svg") or not driver.find_elements(
        "css selector", "#levels table"
    ):
        time.sleep(0.1)
    while driver.find_element("id", "status").text != "ready":
        time.sleep(0.1)


def latency(driver, changes, rests):
    """Milliseconds of every picture while a slider is dragged, and of all that follows where it rests."""
    with serving(changes) as server:
        opened(driver, server.url)
        dragged = driver.execute_async_script(_DRAG, 50, 100, 3000)["picture"]
        rested = {what: [] for what in _SHOWN}
        for _ in range(rests):
            driver.execute_async_script(_DRAG, 10, 1, 0)
            wait_for_all(driver)
            for what, times in driver.execute_script(_MEASURED).items():
                rested[what] += times
        server.shutdown()
    return {
        "dragged": spread(dragged),
        "rested": {what: spread(times) for what, times in rested.items()},
        "work": {what: work(changes, parts, rests) for what, parts in _WORK.items()},
    }


def wait_for_all(driver):
    while not all(driver.execute_script(_MEASURED).values()):
        time.sleep(0.05)


def work(changes, parts, count):
    """Milliseconds of processor time of the server for one change of the wall."""
    explorer = Explorer(avc.load_problem("figure5").changed(frequency=changes), "figure5")
    times = []
    for wall in np.geomspace(1e4, 2e5, count + 1):
        asked = {"settings": {"values": {"environment.stiffness_n_per_m": float(wall)}}}
        if parts != ("now",):
            answer(explorer, PARTS["now"], asked)
        begun = time.process_time()
        for part in parts:
            json.dumps(answer(explorer, PARTS[part], asked))
        times.append(1e3 * (time.process_time() - begun))
    return spread(times[1:])


def spread(times):
    return {"count": len(times), "median_ms": float(np.median(times)), "most_ms": float(np.quantile(times, 0.95))}


def memory(driver, minutes):
    """Resident memory of the server's process, MB, every tenth of the time."""
    command = [sys.executable, "-m", "avc_casadi", "explore", "figure5"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        process.stdout.readline()
        opened(driver, process.stdout.readline().split()[1])
        readings, changes = [resident_mb(process.pid)], 0
        for _ in range(10):
            count = max(1, int(minutes * 60 / 10 / 0.1))
            driver.execute_async_script(_DRAG, 100, count, 500)
            readings.append(resident_mb(process.pid))
            changes += count
        process.send_signal(2)
        process.wait(20)
    return {"minutes": minutes, "changes": changes, "resident_mb": readings, "exit_code": process.returncode}


def resident_mb(pid):
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return int(status.partition("VmRSS:")[2].split()[0]) / 1024


def page(found):
    memory = found["memory"]
    rows = []
    for name, case in found["cases"].items():
        rows.append((name, "impedance and gains, dragged", case["dragged"]))
        rows += [(name, f"{_SHOWN[what]}, at rest", times) for what, times in case["rested"].items()]
    lines = [
        f"| {name} | {what} | {t['median_ms']:.0f} | {t['most_ms']:.0f} | {t['count']} |" for name, what, t in rows
    ]
    kept = ", ".join(f"{value:.0f}" for value in memory["resident_mb"])
    effort = [
        f"| {name} | {what} | {t['median_ms']:.0f} | {t['most_ms']:.0f} |"
        for name, case in found["cases"].items()
        for what, t in case["work"].items()
    ]
    return f"""# avc explore: how fast it follows, and its memory

`{found["command"]}` (version {found["version"]}, headless Chromium on the same
{os.cpu_count()} cores as the server). Other work held these cores: the load was
{found["load"][0]:.0f} while it was measured.

From an input to the frame after the picture, ms by the clock. Dragged: a change of the wall every 50 ms for 5 s; the
time of a picture counts from the oldest change in it. At rest: one change, and nothing until all has followed.

| problem | what | median | 95 % | pictures |
|---|---|--:|--:|--:|
{chr(10).join(lines)}

Processor time of the server for one change, ms.

| problem | what | median | 95 % |
|---|---|--:|--:|
{chr(10).join(effort)}

Memory of the server's process, MB, at the beginning and after each tenth of {memory["minutes"]:g} minutes
in which a script moved the slider {memory["changes"]} times: {kept}. An hour was not measured.
Ctrl-C then ended it with exit code {memory["exit_code"]}.

![explore on a desktop](figures/explore_desktop.png)

![explore on a phone](figures/explore_phone.png)

![report on a desktop](figures/report_desktop.png)

![report on a phone](figures/report_phone.png)

(`{COMMAND} --pictures`)
"""


def pictures(driver, folder):
    with serving({}) as server:
        for name in ("desktop", "phone"):
            resize(driver, WIDTHS[name])
            opened(driver, server.url)
            if name == "desktop":
                driver.find_element("id", "compare").click()
                driver.find_element("id", "f-environment-stiffness_n_per_m").send_keys("\ue009a\ue000", "8000")
                time.sleep(20)
            save(screenshot(driver), f"explore_{name}")
        server.shutdown()
    command = [sys.executable, "-m", "avc_casadi", "run", "figure5", "--out", str(folder / "run")]
    subprocess.run(command, check=True)  # noqa: S603
    for name in ("desktop", "phone"):
        resize(driver, WIDTHS[name])
        driver.get((folder / "run" / "report.html").as_uri())
        time.sleep(1)
        save(screenshot(driver), f"report_{name}")


def save(content, name, tallest=2600):
    """Write a picture in few colours, cut at the foot."""
    image = Image.open(io.BytesIO(content)).convert("RGB")
    image = image.crop((0, 0, image.width, min(image.height, tallest)))
    image.quantize(48, dither=Image.Dither.NONE).save(HERE / "figures" / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
