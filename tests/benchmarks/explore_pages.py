"""How fast the page of `avc explore` follows, and its memory: python -m tests.benchmarks.explore_pages.

A script moves a slider in headless Chromium as a hand does: a change every 50 ms for 5 s, or one change after
the other with a rest between. The times are the page's own, from the event of the input to the frame after the picture.
Memory is that of the server's process while sliders are dragged for a second, left for five so that all follows, and
dragged again. Overwrites explore.json in results and RESULTS_explore.md: --minutes the memory in them, else the times;
with --pictures the screenshots in figures instead.
"""

import argparse
import io
import json
import os
import signal
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
from avc_casadi.present.explore.answers import PARTS, answer
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.server import ExploreServer

HERE = Path(__file__).parent
CASES = {"figure5, 200 frequencies": {}, "1000 frequencies": {"points": 1000}}
COMMAND = "python -m tests.benchmarks.explore_pages"
_SHOWN = {"picture": "impedance and gains", "judge": "certificate, verdict, stiffest wall", "touch": "simulated touch"}
_DRAG = """
const [name, every, count, rest, done] = arguments;
const slider = document.querySelector(`[aria-label='${name}']`);
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
_WALL = "Wall: stiffness"
_DRAGGED = (_WALL, "Device: mass", "Hands: mass, heaviest", _WALL, "Wall: damping", "Device: dry friction")
_WORK = {
    "impedance and gains": ("now",),
    "certificate, verdict, stiffest wall": ("judge",),
    "simulated touch": ("touch",),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, help="move sliders for so long and measure the memory only")
    parser.add_argument("--changes", type=int, default=20, help="changes waited for at rest; default 20")
    parser.add_argument("--pictures", action="store_true", help="take the screenshots only")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, chromium(Path(folder)) as driver:
        if args.pictures:
            pictures(driver, Path(folder))
            return
        driver.set_script_timeout(600)
        results = HERE / "results" / "explore.json"
        found = json.loads(results.read_text(encoding="utf-8"))
        if args.minutes is None:
            cases = {name: latency(driver, changes, args.changes) for name, changes in CASES.items()}
            found["times"] = measured(f"--changes {args.changes}") | {"cases": cases}
        else:
            readings, told = memory(driver, args.minutes), measured(f"--minutes {args.minutes:g}")
            found["memory"] = {**told, **readings}
    results.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (HERE / "RESULTS_explore.md").write_text(page(found), encoding="utf-8")
    print(page(found))


def measured(how):
    return {"command": f"{COMMAND} {how}", "version": avc.__version__, "load": os.getloadavg()}


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
        dragged = driver.execute_async_script(_DRAG, _WALL, 50, 100, 3000)["picture"]
        rested = {what: [] for what in _SHOWN}
        for _ in range(rests):
            driver.execute_async_script(_DRAG, _WALL, 10, 1, 0)
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
    """Resident memory of the server's process, and what the page's script holds, MB, every tenth of the time."""
    command = [sys.executable, "-m", "avc_casadi", "explore", "figure5"]
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a shell's background job would hand on that it is ignored
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        process.stdout.readline()
        opened(driver, process.stdout.readline().split()[1])
        readings, drags, begun = [reading(driver, process.pid)], 0, time.monotonic()
        while len(readings) <= 10:
            driver.execute_async_script(_DRAG, _DRAGGED[drags % len(_DRAGGED)], 100, 10, 5000)
            driver.get_log("performance")  # else the driver keeps it all
            drags += 1
            if time.monotonic() - begun >= 6 * minutes * len(readings):
                readings.append(reading(driver, process.pid))
        process.send_signal(signal.SIGINT)
    server, page = zip(*readings, strict=True)
    return {
        "minutes": minutes,
        "changes": 10 * drags,
        "resident_mb": server,
        "page_mb": page,
    }


def reading(driver, pid):
    driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    return resident_mb(pid), driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"] / 2**20


def resident_mb(pid):
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return int(status.partition("VmRSS:")[2].split()[0]) / 1024


def page(found):
    memory, times = found["memory"], found["times"]
    rows = []
    for name, case in times["cases"].items():
        rows.append((name, "impedance and gains, dragged", case["dragged"]))
        rows += [(name, f"{_SHOWN[what]}, at rest", spent) for what, spent in case["rested"].items()]
    lines = [
        f"| {name} | {what} | {t['median_ms']:.0f} | {t['most_ms']:.0f} | {t['count']} |" for name, what, t in rows
    ]
    effort = [
        f"| {name} | {what} | {t['median_ms']:.0f} | {t['most_ms']:.0f} |"
        for name, case in times["cases"].items()
        for what, t in case["work"].items()
    ]
    kept = [
        f"| {tenth * memory['minutes'] / 10:g} | {server:.0f} | {page:.1f} |"
        for tenth, (server, page) in enumerate(zip(memory["resident_mb"], memory["page_mb"], strict=True))
    ]
    return f"""# avc explore: how fast it follows, and its memory

## How fast it follows

`{times["command"]}` (version {times["version"]}, headless Chromium on the same
{os.cpu_count()} cores as the server). The load of these cores was {times["load"][0]:.0f} while it was measured.

From an input to the frame after the picture, ms by the clock. Dragged: a change of the wall every 50 ms for 5 s; the
time of a picture counts from the oldest change in it. At rest: one change, and nothing until all has followed.

| problem | what | median | 95 % | pictures |
|---|---|--:|--:|--:|
{chr(10).join(lines)}

Processor time of the server for one change, ms.

| problem | what | median | 95 % |
|---|---|--:|--:|
{chr(10).join(effort)}

## Memory

`{memory["command"]}` (version {memory["version"]}; load of the machine {memory["load"][0]:.0f} at its end)

A script moved sliders of wall, device and hands {memory["changes"]} times in {memory["minutes"]:g} minutes: ten times
within a second, then five seconds of rest in which certificate, verdict, touch and region follow. The server is its
process (resident), the page what its script holds after a collection.

| minute | server, MB | page, MB |
|--:|--:|--:|
{chr(10).join(kept)}

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
    image.quantize(128, dither=Image.Dither.NONE).save(HERE / "figures" / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
