"""`avc explore` in Chromium: it follows sliders and typing, tells faults, keeps its settings, and asks nobody else."""

import multiprocessing
import re
import threading
import time
from urllib.parse import quote

import pytest
from background_work import endless
from browser import (
    WIDTHS,
    by_id,
    chromium,
    console_errors,
    requested,
    resize,
    shown,
    state,
    sticks_out_by,
    typed,
    until,
)

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.explore import explorer as _explorer
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.server import ExploreServer

WALL = "f-environment-stiffness_n_per_m"


@pytest.fixture(scope="module")
def server():
    with ExploreServer(Explorer(avc.load_problem("figure5").changed(frequency={"points": 40}), "figure5")) as started:
        threading.Thread(target=started.serve_forever, daemon=True).start()
        yield started
        started.shutdown()


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
            " && document.querySelector('#c-region svg') !== null && document.querySelector('#law tbody tr') !== null"
        )
    )


@pytest.mark.thorough
def test_a_slider_moves_the_picture_and_undo_brings_it_back(page):
    before = shown(page, "c-magnitude")
    slider = page.find_element("css selector", "[aria-label='Wall: stiffness']")
    slider.send_keys("\ue012" * 3)  # arrow left
    until(lambda: shown(page, "c-magnitude") != before)
    assert float(by_id(page, WALL).get_attribute("value")) < 1e5
    by_id(page, "undo").click()
    until(lambda: shown(page, "c-magnitude") == before)
    assert float(by_id(page, WALL).get_attribute("value")) == 1e5
    settled(page)


@pytest.mark.thorough
def test_faults_stand_beside_their_fields_all_at_once(page):
    typed(page, WALL, "-8000")
    typed(page, "f-device-mass_kg", "heavy")
    told = until(lambda: by_id(page, f"{WALL}-error").text and by_id(page, "f-device-mass_kg-error").text)
    assert "not a number; allowed: 0 or 1e-9 to 1e6 kg" in told
    assert "-8000" in by_id(page, f"{WALL}-error").text
    assert by_id(page, WALL).get_attribute("aria-invalid") == "true"
    typed(page, WALL, "8000")
    typed(page, "f-device-mass_kg", "0.1")
    until(lambda: not by_id(page, f"{WALL}-error").text and not by_id(page, "f-device-mass_kg-error").text)
    settled(page)


@pytest.mark.thorough
def test_settings_survive_a_reload_and_stay_in_their_own_tab(page, server):
    typed(page, WALL, "9000")
    by_id(page, "compare").click()
    typed(page, WALL, "4000")
    until(lambda: (state(page).get("b") or {}).get("values", {}).get("environment.stiffness_n_per_m") == 4000)
    first = page.current_window_handle
    page.switch_to.new_window("tab")
    page.get(server.url)
    settled(page)
    assert float(by_id(page, WALL).get_attribute("value")) == 1e5
    page.close()
    page.switch_to.window(first)
    page.refresh()
    settled(page)
    assert float(by_id(page, WALL).get_attribute("value")) == 4000
    assert state(page)["a"]["values"] == {"environment.stiffness_n_per_m": 9000}
    assert [cell.text for cell in page.find_elements("css selector", "#verdict thead th")] == ["what", "A", "B"]


@pytest.mark.thorough
def test_an_address_with_unknown_names_says_which_and_shows_the_rest(page, server):
    odd = '{"a":{"values":{"environment.stiffness_n_per_m":8000,"environment.colour":3},"method":"magic","odd":1}}'
    page.get("about:blank")
    page.get(f"{server.url}#{quote(odd)}")
    settled(page)
    assert float(by_id(page, WALL).get_attribute("value")) == 8000
    told = by_id(page, "address-says").text
    assert all(name in told for name in ("environment.colour", 'method "magic"', "odd"))
    page.get("about:blank")
    page.get(f"{server.url}#%7Bnot")
    settled(page)
    assert "all of it" in by_id(page, "address-says").text


@pytest.mark.thorough
def test_what_was_said_of_a_file_goes_with_the_settings_it_was_about(page):
    page.find_element("css selector", "#method option[value='recommend']").click()
    by_id(page, "save-coupling").click()
    until(lambda: by_id(page, "file-says").text.startswith("Not saved"))
    page.find_element("css selector", "#method option[value='direct']").click()
    until(lambda: by_id(page, "file-says").text == "")


@pytest.mark.thorough
def test_the_star_of_the_wanted_wall_stands_whole_inside_the_axes(page):
    for wall in ("5e6", "10"):
        typed(page, WALL, wall)
        until(lambda wall=wall: state(page)["a"]["values"].get("environment.stiffness_n_per_m") == float(wall))
        settled(page)
        inside = page.execute_script(
            "const box = (one) => one.getBBox(), frame = box(document.querySelector('#c-region clipPath rect')),"
            " star = box(document.querySelector('#c-region g polygon'));"
            "return star.y >= frame.y && star.y + star.height <= frame.y + frame.height"
            " && star.x >= frame.x && star.x + star.width <= frame.x + frame.width"
        )
        assert inside, wall


@pytest.mark.thorough
def test_a_slow_server_is_waited_for_and_the_last_setting_wins(page, server, monkeypatch):
    whole, seen = server.explorer.schedule, threading.Event()

    def slowly(settings):
        seen.wait()
        return whole(settings)

    monkeypatch.setattr(server.explorer, "schedule", slowly)
    try:
        for text in ("7000", "6000", "5000"):
            typed(page, WALL, text)
        until(lambda: by_id(page, "status").text == "computing")
    finally:
        seen.set()
    settled(page)
    assert "5000 N/m" in shown(page, "c-region")


@pytest.mark.thorough
def test_files_are_saved_as_they_were_set(page, tmp_path):
    page.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    page.find_element("css selector", "#device option[value='novint-falcon']").click()
    typed(page, WALL, "8000")
    page.find_element("css selector", "#method option[value='constant']").click()
    typed(page, "f-gains-stiffness_n_per_m", "900")
    until(lambda: "900 to 900 N/m" in shown(page, "c-stiffness"))
    for name in ("save-problem", "save-coupling"):
        by_id(page, name).click()
        until(lambda: by_id(page, "file-says").text.startswith("Saved"))
    problem = avc.load_problem(until(lambda: next(tmp_path.glob("*.toml"), None)))
    assert problem.device == avc.load_device("novint-falcon").device
    assert problem.environment.stiffness_n_per_m == 8000
    coupling = avc.read_coupling(until(lambda: next(tmp_path.glob("*.json"), None)))
    assert coupling.table.rows[0, 1:].tolist() == [0.0, 900.0, 0.0]
    by_id(page, "copy-command").click()
    assert "avc compare novint-falcon-explored.toml --mine 900,0" in until(lambda: by_id(page, "command").text)


@pytest.mark.thorough
def test_faults_are_told_in_the_unit_of_the_field_and_open_its_group(page):
    typed(page, "f-device-sample_time_s", "-2")
    page.execute_script("document.getElementById('f-device-range-mass_kg-1').closest('details').open = true")
    typed(page, "f-device-range-mass_kg-1", "0.01")
    page.execute_script("document.getElementById('f-device-range-mass_kg-1').closest('details').open = false")
    typed(page, "f-device-sample_time_s", "-3")
    told = until(lambda: by_id(page, "f-device-sample_time_s-error").text)
    assert "allowed: 0.0001 to 10000 ms" in told
    assert "reversed" in until(lambda: by_id(page, "f-device-range-mass_kg-1-error").text)  # beside what was typed
    typed(page, "f-device-sample_time_s", "1")
    typed(page, "f-device-range-mass_kg-1", "0.2")
    until(lambda: by_id(page, "f-device-range-mass_kg-0").get_attribute("value") == "0.1")


@pytest.mark.thorough
def test_a_run_goes_on_beside_other_settings_and_can_be_cancelled(page, monkeypatch):
    monkeypatch.setattr(_explorer, "_worked", endless)
    monkeypatch.setattr(_explorer, "_UNASKED_S", 9.0)
    page.find_element("css selector", "#method option[value='recommend']").click()
    until(lambda: by_id(page, "work-begin").is_displayed() and "Press Run" in by_id(page, "next").text)
    by_id(page, "work-begin").click()
    until(lambda: by_id(page, "work-cancel").is_displayed())
    page.find_element("css selector", "#method option[value='direct']").click()
    settled(page)
    time.sleep(11)
    page.find_element("css selector", "#method option[value='recommend']").click()
    until(lambda: by_id(page, "work-cancel").is_displayed())
    by_id(page, "work-cancel").click()
    until(lambda: by_id(page, "work-says").text == "Ended: cancelled")
    assert by_id(page, "work-begin").is_displayed()
    assert not by_id(page, "work-cancel").is_displayed()
    assert multiprocessing.active_children() == []


@pytest.mark.thorough
def test_typed_gains_take_a_decimal_comma_and_are_drawn(page):
    page.find_element("css selector", "#method option[value='constant']").click()
    until(lambda: "no force is rendered" in by_id(page, "f-gains-stiffness_n_per_m-error").text)
    typed(page, "f-gains-stiffness_n_per_m", "900,5")
    typed(page, "f-gains-contact_damping_ns_per_m", "5")
    gains = {"stiffness_n_per_m": 900.5, "contact_damping_ns_per_m": 5}
    until(lambda: state(page)["a"].get("gains") == gains)
    legend = "return [...document.querySelectorAll('#c-region .legend li')].map((one) => one.textContent)"
    curves = [one for one in page.execute_script(legend) if "wanted" not in one and "encoder" not in one]
    assert len(curves) == page.execute_script("return document.querySelectorAll('#c-region svg path.line').length")


@pytest.mark.thorough
def test_an_address_that_holds_no_settings_says_so(page):
    for part in ("[]", "3", "null"):
        page.execute_script("location.hash = arguments[0]", part)
        until(lambda: "left out: all of it" in by_id(page, "address-says").text)
        page.execute_script("location.hash = ''")
        until(lambda: by_id(page, "address-says").text == "")


@pytest.mark.thorough
def test_an_address_is_read_though_the_page_was_about_to_write_its_own(page):
    wanted = '{"a": {"values": {"environment.stiffness_n_per_m": 7000}}}'
    page.execute_script("location.hash = arguments[0]; history.replaceState(null, '', '#%7B%7D')", wanted)
    until(lambda: by_id(page, WALL).get_attribute("value") == "7000", 60)
    settled(page)


def test_a_gain_at_one_frequency_alone_is_a_mark(page):
    drawn = page.execute_async_script(
        """
        const done = arguments[0];
        import(new URL('charts.js', location.href)).then(({ chart }) => {
          const host = document.createElement('figure');
          host.id = 'alone';
          document.body.append(host);
          const y = [1, null, 3, null, 5, 6, null];
          chart(host, { title: 't', summary: 's', x: { label: 'x', kind: 'linear' }, y: { label: 'y', kind: 'linear' },
            series: [{ name: 'one', cls: 'a', x: [1, 2, 3, 4, 5, 6, 7], y }] });
          const marks = [...host.querySelectorAll('g circle.alone')].map((one) => Number(one.getAttribute('cx')));
          const line = host.querySelector('g path.line').getAttribute('d');
          host.remove();
          done([marks, line]);
        });
        """
    )
    assert len(drawn[0]) == 2
    assert drawn[1].count("M") == drawn[1].count("L") == 1


@pytest.mark.thorough
def test_a_knob_is_shown_in_its_own_units(driver):
    with ExploreServer(Explorer(avc.load_problem("knob").changed(frequency={"points": 30}), "knob")) as turning:
        threading.Thread(target=turning.serve_forever, daemon=True).start()
        driver.get(turning.url)
        settled(driver)
        assert "N·m/rad" in by_id(driver, "verdict").text
        text = driver.execute_script("return document.body.textContent")
        assert not re.search(r"N·s/m|N/m|kg(?!·m²)", text)
        assert console_errors(driver) == []
        driver.get("about:blank")
        turning.shutdown()
    requested(driver)


def found_at_once(task, progress):
    """In place of the search of `recommend`, which has tests of its own: a coupling that holds on a Falcon."""
    problem, _ = task
    progress.advance(1, 2, "trial")
    return Coupling.constant(problem, Gains(0.0, 1000.0, 5.0), "recommend"), ["deploy: a softened wall"]


@pytest.mark.thorough
def test_a_newcomer_gets_from_the_page_to_both_files(page, tmp_path, monkeypatch):
    """As it was tried: device, wall, what the page says to do next, and Save."""
    monkeypatch.setattr(_explorer, "_worked", found_at_once)
    page.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    page.find_element("css selector", "#device option[value='novint-falcon']").click()
    typed(page, WALL, "8000")
    until(lambda: "choose recommend, under Method" in by_id(page, "next").text)
    page.find_element("css selector", "#method option[value='recommend']").click()
    until(lambda: "Press Run" in by_id(page, "next").text and by_id(page, "work-begin").is_displayed())
    by_id(page, "work-begin").click()
    until(lambda: "✓ deployable" in by_id(page, "verdict").text)
    assert by_id(page, "told").text == "deploy: a softened wall"
    assert by_id(page, "title").text == "avc explore: Wall of 8000 N/m for novint-falcon"
    for name in ("save-problem", "save-coupling"):
        by_id(page, name).click()
        until(lambda: by_id(page, "file-says").text.startswith("Saved"))
    problem = avc.load_problem(until(lambda: next(tmp_path.glob("*.toml"), None)))
    coupling = avc.read_coupling(until(lambda: next(tmp_path.glob("*.json"), None)))
    assert problem.device == coupling.problem.device == avc.load_device("novint-falcon").device
    assert problem.environment == coupling.problem.environment
    assert problem.environment.stiffness_n_per_m == 8000
    assert coupling.table.rows[0, 1:].tolist() == [0.0, 1000.0, 5.0]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("size", "scheme"),
    [("desktop", "light"), ("desktop", "dark"), ("tablet", "light"), ("phone", "light"), ("phone", "dark")],
)
def test_nothing_sticks_out_and_nothing_is_hidden_from_anybody(page, size, scheme):
    resize(page, WIDTHS[size])
    page.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    )
    page.refresh()
    settled(page)
    page.execute_script("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    assert sticks_out_by(page) <= 0
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    resize(page, WIDTHS["desktop"])


@pytest.mark.thorough
def test_a_finger_moves_a_slider_on_a_phone(page):
    resize(page, WIDTHS["phone"])
    page.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True})
    page.refresh()
    settled(page)
    columns = page.execute_script(
        "return getComputedStyle(document.querySelector('.columns')).gridTemplateColumns.split(' ').length"
    )
    assert columns == 1
    slider = page.find_element("css selector", "[aria-label='Wall: stiffness']")
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", slider)
    box = page.execute_script("return arguments[0].getBoundingClientRect().toJSON()", slider)
    assert box["height"] >= 22
    assert box["width"] > 0.8 * WIDTHS["phone"]
    place = {"x": box["x"] + 0.3 * box["width"], "y": box["y"] + box["height"] / 2}
    page.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [place]})
    page.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    until(lambda: 1e3 < float(by_id(page, WALL).get_attribute("value")) < 3e3)
    page.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    resize(page, WIDTHS["desktop"])
    settled(page)


@pytest.mark.thorough
def test_it_opens_with_an_answer_and_no_empty_frame_while_a_run_goes_on(driver, monkeypatch):
    monkeypatch.setattr(_explorer, "_worked", endless)
    with ExploreServer(Explorer(avc.load_problem("soft").changed(frequency={"points": 40}), "soft.toml")) as started:
        threading.Thread(target=started.serve_forever, daemon=True).start()
        driver.get("about:blank")
        driver.get(started.url)
        until(lambda: "Damping ratio" in by_id(driver, "law").text and shown(driver, "c-position"))
        assert state(driver)["a"]["method"] == "recommend"
        assert "your k and b" in by_id(driver, "c-magnitude").text
        figures = driver.find_elements("css selector", "main figure")
        assert [
            one.get_attribute("id") for one in figures if one.is_displayed() and "Nothing to draw" in one.text
        ] == []
        assert "yes: stable" in by_id(driver, "law").text
        typed(driver, "f-own-stiffness_n_per_m", "1000000")
        until(lambda: "no: unstable" in by_id(driver, "law").text)
        assert state(driver)["a"]["own"] == {"stiffness_n_per_m": 1000000}
        started.explorer.close()
        started.shutdown()
