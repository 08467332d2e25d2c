"""`avc explore` of a problem with [simulation] in Chromium: every slider, K and B, faults, a run, files, a wheel."""

import json
import re
import threading

import pytest
from browser import (
    WIDTHS,
    by_id,
    chromium,
    console_errors,
    resize,
    shown,
    state,
    sticks_out_by,
    typed,
    until,
)

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.virtual_tool import ToolGains
from avc_casadi.present.explore import explorer as _explorer
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.server import ExploreServer

pytestmark = pytest.mark.thorough
K = "f-gains-stiffness_n_per_m"
ANSWERED = (
    "return performance.getEntriesByName('picture').length || document.querySelector('[aria-invalid=true]') !== null"
)
MASS = "f-simulation-tool_mass_kg-0"


def found_at_once(task, progress):
    """In place of the search of `recommend`, which has tests of its own."""
    progress.advance(1, 2, "K of 5 kN/m")
    trial = {"rendered_stiffness_n_per_m": 4000.0}
    return Coupling.between(task[0], ToolGains(4000.0, 15.0), None, trial), ["✓ Simulated: 100 of 100 hands settle"]


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("browser")) as started:
        yield started


@pytest.fixture
def page(driver, monkeypatch):
    """The page of the catalogue's tool in MuJoCo, its first run done."""
    monkeypatch.setattr(_explorer, "_worked", found_at_once)
    with opened(driver, "tool/mujoco-500hz"):
        until(lambda: "4.00 kN/m pressed" in by_id(driver, "verdict").text)
        settled(driver)
        yield driver
        assert console_errors(driver) == []
        driver.get("about:blank")


class opened:  # noqa: N801 - a context of a test
    def __init__(self, driver, name):
        self.driver, self.server = driver, ExploreServer(Explorer(avc.load_problem(name), name))

    def __enter__(self):
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.driver.get("about:blank")
        self.driver.get(self.server.url)
        settled(self.driver)
        return self.server

    def __exit__(self, *_):
        self.server.shutdown()
        self.server.explorer.close()
        self.server.server_close()


def settled(driver):
    until(
        lambda: driver.execute_script(
            "return document.getElementById('status').textContent === 'ready'"
            " && !document.querySelector('main').classList.contains('stale')"
            " && document.querySelector('#c-pairs svg') !== null && document.querySelector('#c-force svg') !== null"
        )
    )


def test_every_slider_is_followed(page):
    """Each is moved to a third of its way, and back by Undo: an answer or a fault beside its own field comes."""
    page.find_element("css selector", "#method option[value='constant']").click()
    page.execute_script("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    until(lambda: state(page)["a"].get("method") == "constant")
    settled(page)
    before = state(page)["a"]
    names = page.execute_script(
        "return [...document.querySelectorAll('#controls input[type=range]')].map((one) => one.ariaLabel)"
    )
    assert len(names) > 35
    for name in names:
        page.execute_script(
            "performance.clearMeasures();"
            'const slider = document.querySelector(`#controls [aria-label="${arguments[0]}"]`);'
            "slider.value = slider.value < 500 ? 620 : 340; slider.dispatchEvent(new Event('input', {bubbles: true}))",
            name,
        )
        until(lambda: state(page)["a"] != before)  # the address is written a little later
        until(lambda: page.execute_script(ANSWERED))
        faults = page.find_elements("css selector", "[aria-invalid=true]")
        if faults:  # a range that this has turned round
            assert faults[0].get_attribute("id").rstrip("01").endswith("-"), name
        else:
            settled(page)
            assert "Stability" in by_id(page, "verdict").text, name
        assert by_id(page, "general-error").text == "", name
        by_id(page, "undo").click()
        until(lambda: state(page)["a"] == before)
    settled(page)


def test_k_and_b_move_the_star_and_the_verdict_and_undo_brings_them_back(page):
    assert "K 4000 N/m, B 15 N·s/m" in shown(page, "c-pairs")
    slider = page.find_element("css selector", "[aria-label='Spring and damper: spring K']")
    slider.send_keys("\ue014")  # arrow right
    until(lambda: by_id(page, "method").get_attribute("value") == "constant")
    until(lambda: "K 4000 N/m" not in shown(page, "c-pairs"))
    until(lambda: state(page)["a"]["gains"].get("damping_ns_per_m") == 15.0)  # typing begins with what was shown
    typed(page, K, "90000")
    until(lambda: "K 90000 N/m, B 15 N·s/m, not stable" in shown(page, "c-pairs"))
    until(lambda: "✗ not all of 18 loops are stable" in by_id(page, "verdict").text)
    assert "less K, or recommend" in by_id(page, "next").text
    while by_id(page, "undo").is_enabled():
        by_id(page, "undo").click()
    until(lambda: "K 4000 N/m, B 15 N·s/m" in shown(page, "c-pairs"))
    settled(page)


def test_a_lighter_tool_and_a_slower_engine_are_seen_at_once(page):
    before = shown(page, "c-pairs")
    typed(page, MASS, "0.05")
    until(lambda: "tool 50.0 g at 500 Hz" in by_id(page, "headline").text)
    until(lambda: "not tried yet" in by_id(page, "next").text)
    settled(page)
    until(lambda: shown(page, "c-pairs") != before)
    slider = page.find_element("css selector", "[aria-label='Tool and engine: engine step']")
    slider.send_keys("\ue00e" * 2)  # page up
    until(lambda: float(by_id(page, "f-simulation-step_s-0").get_attribute("value")) != 2)
    assert float(by_id(page, "f-simulation-step_s-0").get_attribute("value")).is_integer()  # multiples of T
    page.find_element("css selector", "#f-simulation-exchange option[value='ahead']").click()
    until(lambda: "ahead" in by_id(page, "headline").text and "is ahead: the device" in by_id(page, "verdict").text)
    settled(page)
    by_id(page, "work-begin").click()
    until(lambda: "4.00 kN/m pressed" in by_id(page, "verdict").text)
    assert by_id(page, "told").text == "✓ Simulated: 100 of 100 hands settle"
    settled(page)


def test_faults_stand_beside_their_fields_all_at_once(page):
    typed(page, MASS, "-1")
    typed(page, K, "much")
    typed(page, "f-simulation-step_s-0", "0")
    for name, text in (
        (MASS, "allowed: 1e-9 to 1e6 kg"),
        (K, "a number from 0 to 1e12 N/m"),
        ("f-simulation-step_s-0", "allowed: 0.0001 to 10000 ms"),
    ):
        until(lambda name=name, text=text: text in by_id(page, f"{name}-error").text)
        assert by_id(page, name).get_attribute("aria-invalid") == "true"
    assert page.find_element("css selector", "main.stale")
    typed(page, MASS, "0.2")
    typed(page, K, "4000")
    typed(page, "f-simulation-step_s-0", "2")
    until(lambda: not by_id(page, f"{MASS}-error").text and not by_id(page, f"{K}-error").text)
    settled(page)


def test_two_settings_are_compared_and_saved(page, tmp_path):
    page.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    by_id(page, "compare").click()
    typed(page, MASS, "0.4")
    until(lambda: "A: K 4000" in shown(page, "c-pairs") and "B: K" in shown(page, "c-pairs"))
    settled(page)
    # Read at once, in the page: the table may be drawn anew meanwhile.
    heads = "return [...document.querySelectorAll('#verdict thead th')].map((cell) => cell.textContent)"
    until(lambda: page.execute_script(heads) == ["what", "A", "B"])
    for name in ("save-problem", "save-coupling"):
        by_id(page, name).click()
        until(lambda: by_id(page, "file-says").text.startswith("Saved"))
    problem = avc.load_problem(until(lambda: next(tmp_path.glob("*.toml"), None)))
    assert problem.simulation.tool_mass_kg == (0.4, 0.4)
    saved = json.loads(until(lambda: next(tmp_path.glob("*.json"), None)).read_text(encoding="utf-8"))
    assert saved["schema"] == "avc-coupling/1"
    assert saved["problem_file"]["simulation"]["tool_mass_kg"] == [0.4, 0.4]
    by_id(page, "copy-command").click()
    assert "avc recommend mujoco-500hz-explored-b.toml" in until(lambda: by_id(page, "command").text).replace(
        "tool-", ""
    )


@pytest.mark.parametrize("name", ["tool/wheel-game-62hz", "tool/unity-60hz", "tool/sofa-implicit"])
def test_the_catalogue_is_shown_in_its_own_units(driver, name, monkeypatch):
    monkeypatch.setattr(_explorer, "_worked", found_at_once)
    turns = name == "tool/wheel-game-62hz"
    with opened(driver, name):

        def units():
            text = driver.execute_script("return document.querySelector('.columns').textContent")
            return "N·m/rad" in text, bool(re.search(r"N·s/m|N/m|kg(?!·m²)", text))

        until(lambda: units() == (turns, not turns))
        assert by_id(driver, "c-free").is_displayed() is not turns
        assert "as declared" in by_id(driver, "c-pairs").text
        assert console_errors(driver) == []
        driver.get("about:blank")


@pytest.mark.parametrize(("size", "scheme"), [("desktop", "light"), ("desktop", "dark"), ("phone", "dark")])
def test_nothing_sticks_out_and_nothing_is_hidden_from_anybody(page, size, scheme):
    resize(page, WIDTHS[size])
    page.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    )
    page.refresh()
    settled(page)
    page.execute_script("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    typed(page, K, "90000")
    until(lambda: "✗" in by_id(page, "verdict").text)
    assert sticks_out_by(page) <= 0
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    resize(page, WIDTHS["desktop"])
    settled(page)
