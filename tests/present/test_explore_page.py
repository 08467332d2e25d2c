"""`avc explore` in Chromium: it follows sliders and typing, tells faults, keeps its settings, and asks nobody else."""

import threading
from contextlib import contextmanager

import pytest
from browser import by_id, chromium, console_errors, requested, shown, until

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.explore import explorer as _explorer
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.server import ExploreServer
from avc_casadi.present.row import row

WALL, MASS, K = "f-environment-stiffness_n_per_m", "f-device-mass_kg", "f-stiffness_n_per_m"


@contextmanager
def served(problem, source):
    with ExploreServer(Explorer(problem, source)) as started:
        threading.Thread(target=started.serve_forever, daemon=True).start()
        yield started
        started.explorer.close()
        started.shutdown()


@pytest.fixture(scope="module")
def server():
    with served(avc.load_problem("figure5").changed(frequency={"points": 40}), "figure5") as started:
        yield started


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("browser")) as started:
        yield started


@pytest.fixture
def page(driver, server):
    driver.get("about:blank")
    requested(driver)
    driver.get(server.url)
    settled(driver)
    yield driver
    assert console_errors(driver) == []
    own = (f"http://127.0.0.1:{server.port}/", "data:", "blob:", "about:")
    assert [url for url in requested(driver) if not url.startswith(own)] == []


def settled(driver):
    until(
        lambda: driver.execute_script(
            "return document.getElementById('status').textContent === 'ready'"
            " && !document.querySelector('main').classList.contains('stale')"
            " && document.querySelector('#own tbody tr') !== null"
        )
    )


def text(driver, name):
    return driver.execute_script("return document.getElementById(arguments[0]).textContent", name)


@pytest.mark.slow
def test_a_slider_moves_the_picture_and_undo_brings_it_back(page):
    before = shown(page, "c-magnitude")
    slider = page.find_element("css selector", "[aria-label='Wall: stiffness']")
    slider.send_keys("\ue012" * 3)  # arrow left
    until(lambda: shown(page, "c-magnitude") != before)
    assert float(by_id(page, WALL).get_attribute("value")) < 1e5
    by_id(page, "undo").click()
    until(lambda: shown(page, "c-magnitude") == before)
    assert float(by_id(page, WALL).get_attribute("value")) == 1e5


def found_at_once(task, progress):
    """In place of the search of `recommend`, which has tests of its own."""
    progress.advance(1, 2, "trial")
    return Coupling.constant(task[0], Gains(0.0, 1000.0, 5.0), "recommend"), [row("Coupling", "a softened wall")]


@pytest.mark.slow
def test_a_run_is_begun_followed_and_its_coupling_saved(page, tmp_path, monkeypatch):
    monkeypatch.setattr(_explorer, "_solved", found_at_once)
    page.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    page.find_element("css selector", "#method option[value='recommend']").click()
    until(lambda: by_id(page, "run").is_displayed())
    by_id(page, "run").click()
    until(lambda: "a softened wall" in text(page, "coupling") and shown(page, "c-magnitude"))
    settled(page)
    by_id(page, "save-coupling").click()
    coupling = avc.read_coupling(until(lambda: next(tmp_path.glob("*.json"), None)))
    assert coupling.table.rows[0, 1:].tolist() == [0.0, 1000.0, 5.0]
