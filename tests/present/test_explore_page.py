"""`avc explore` in Chromium: what matters stays in sight on a laptop and a phone, and the page asks nobody else."""

import threading
from contextlib import contextmanager

import pytest
from browser import SIZES, by_id, chromium, console_errors, in_sight, requested, shown, sized, sticking_out, until

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.explore import explorer as _explorer
from avc_casadi.present.explore.explorer import Explorer, Solved
from avc_casadi.present.explore.server import OPENS_WITH, ExploreServer, answer, warm
from avc_casadi.present.explore.verdict import Judged, Verdict
from avc_casadi.present.row import Mark, row

TOOL = avc.load_problem("tool/mujoco-500hz")
WALL, MASS, K = "f-environment-stiffness_n_per_m", "f-device-mass_kg", "f-stiffness_n_per_m"


@contextmanager
def served(problem, source):
    with ExploreServer(Explorer(problem, source)) as started:
        threading.Thread(target=started.serve_forever, daemon=True).start()
        yield started
        started.explorer.close()
        started.shutdown()


def found_at_once(task, progress):
    """In place of the search of `recommend`, which has tests of its own."""
    problem, _ = task
    progress.advance(1, 2, "trial")
    judged = Judged(Verdict(Mark.PASS, "deployable", ("disk margin", "0.42")), [row("Coupling", "a softened wall")])
    if problem.simulation is not None:
        return Solved(None, judged)
    return Solved(Coupling.constant(problem, Gains(0.0, 1000.0, 5.0), "recommend"), judged)


@pytest.fixture(scope="module", autouse=True)
def quick():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_explorer, "_solved", found_at_once)
        yield


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
    sized(driver, "laptop")
    requested(driver)
    driver.get(server.url)
    until(lambda: "a softened wall" in text(driver, "rows"))
    settled(driver)
    yield driver
    assert console_errors(driver) == []
    own = (f"http://127.0.0.1:{server.port}/", "data:", "blob:", "about:")
    assert [url for url in requested(driver) if not url.startswith(own)] == []


def settled(driver):
    until(
        lambda: driver.execute_script(
            "return document.getElementById('status').textContent === 'ready'"
            " && !document.querySelector('main').classList.contains('behind')"
            " && document.querySelector('#rows tbody tr') !== null"
            " && document.getElementById('cancel').hidden"
        )
    )


def text(driver, name):
    return driver.execute_script("return document.getElementById(arguments[0]).textContent", name)


@pytest.mark.slow
def test_a_slider_moves_the_picture_and_undo_brings_it_back(page):
    settled(page)  # what is drawn before is the whole picture

    def stiffness():
        return float(by_id(page, WALL).get_attribute("value"))

    before = shown(page, "c-magnitude")
    slider = page.find_element("css selector", "[aria-label='Wall: stiffness']")
    slider.send_keys("\ue012" * 3)  # arrow left
    until(lambda: stiffness() < 1e5)
    until(lambda: shown(page, "c-magnitude") != before)
    # Presses that are further apart than 900 ms are steps of their own.
    until(lambda: by_id(page, "undo").click() or stiffness() == 1e5)
    settled(page)
    until(lambda: shown(page, "c-magnitude") == before)


@pytest.mark.slow
def test_a_page_opens_on_the_recommended_coupling_which_is_saved(page, tmp_path):
    page.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    assert "0.42" in text(page, "verdicts")
    by_id(page, "save-coupling").click()
    coupling = avc.read_coupling(
        until(lambda: next((path for path in tmp_path.glob("*.json") if path.stat().st_size), None))
    )
    assert coupling.table.rows[0, 1:].tolist() == [0.0, 1000.0, 5.0]


@pytest.mark.slow
def test_a_run_of_other_settings_is_begun_by_its_button(page):
    page.find_element("css selector", "[aria-label='Wall: stiffness']").send_keys("\ue012" * 3)
    until(lambda: by_id(page, "run").is_displayed())
    until(lambda: "press Run" in text(page, "verdicts"))
    by_id(page, "run").click()
    until(lambda: "a softened wall" in text(page, "rows"))


@pytest.mark.slow
def test_rows_of_one_label_face_each_other(page):
    page.find_element("css selector", "#method option[value='direct']").click()
    until(lambda: "by direct" in text(page, "rows"))
    settled(page)
    rows = page.find_elements("css selector", "#rows tbody tr")
    labels = [line.find_element("css selector", "th").text for line in rows]
    assert len(labels) == len(set(labels))
    verdicts = rows[labels.index("Deployable")].find_elements("css selector", "td")
    assert [verdict.text[:5] for verdict in verdicts] == ["✓ yes", "✗ no:"]


def drag(driver, name):
    """Take the slider of a value, far to the right and half the way back, and yield after each move."""
    slider = driver.find_element("css selector", f"[aria-label='{name}']")
    driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", slider)
    for share in (0.9, 0.2, 0.6):
        driver.execute_script(
            "arguments[0].value = arguments[1] * arguments[0].max;"
            "arguments[0].dispatchEvent(new Event('input', {bubbles: true}))",
            slider,
            share,
        )
        yield slider


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", ["Your own k and b: spring k", "Device: mass", "Hands: stiffness, most"])
def test_verdict_and_margin_are_in_sight_while_a_slider_moves(page, size, name):
    sized(page, size)
    settled(page)
    for group in page.find_elements("css selector", "details:not([open]) > summary"):
        page.execute_script("arguments[0].click()", group)
    before = text(page, "verdicts")
    for slider in drag(page, name):
        assert in_sight(page, slider)
        for verdict in page.find_elements("css selector", "#verdicts .verdict"):
            assert in_sight(page, verdict)
    settled(page)
    assert text(page, "verdicts") != before
    assert "margin" in text(page, "verdicts") or "unstable" in text(page, "verdicts")


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_pictures_lie_above_the_fold_and_nothing_sticks_out(page, size):
    sized(page, size)
    settled(page)
    drawn = [figure for figure in page.find_elements("css selector", "#charts figure") if figure.is_displayed()]
    assert len(drawn) == (3 if size == "laptop" else 1)
    assert all(in_sight(page, figure.find_element("css selector", "svg")) for figure in drawn)
    assert sticking_out(page) == []
    by_id(page, "compare").click()
    settled(page)
    assert sticking_out(page) == []
    # No axis, label or line of a picture is cut by its edge.
    cut = """const inner = arguments[0].getBBox();
    return inner.x < 0 || inner.x + inner.width > arguments[0].viewBox.baseVal.width + 1"""
    for picture in page.find_elements("css selector", "figure.picked > svg"):
        assert not page.execute_script(cut, picture)


@pytest.mark.slow
def test_a_phone_shows_the_picture_that_is_picked(page):
    sized(page, "phone")
    settled(page)
    page.find_element("css selector", "#picture option[value='region']").click()
    until(lambda: by_id(page, "c-region").is_displayed() and shown(page, "c-region"))
    assert not by_id(page, "c-magnitude").is_displayed()


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_a_coupling_to_a_simulation_is_shown_in_the_same_way(driver, size):
    with served(TOOL, "tool/mujoco-500hz") as server:
        sized(driver, size)
        driver.get(server.url)
        settled(driver)
        for slider in drag(driver, "Your own K and B: spring K"):
            assert in_sight(driver, slider)
            assert in_sight(driver, by_id(driver, "verdicts"))
        settled(driver)
        assert sticking_out(driver) == []


@pytest.mark.slow
def test_the_first_picture_does_not_wait_for_a_law_to_begin_with():
    problem = avc.load_problem("reference-r1").changed(frequency={"points": 12})
    explorer = Explorer(problem, "reference-r1")
    question = {"settings": OPENS_WITH, "extent": "pictures"}
    begun = answer(explorer, "evaluate", question)
    assert begun["gains"] == {}
    assert [line["cls"] for line in begun["charts"][0]["series"]] == ["desired", "without"]
    warm(explorer)
    assert [line["cls"] for line in answer(explorer, "evaluate", question)["charts"][0]["series"]][-1] == "own"
