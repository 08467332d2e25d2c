"""Whatever a problem file holds, it loads or is refused with faults that say something; and nothing hangs."""

import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import avc_casadi as avc

VALID = (
    avc.catalogue_path("figure5").read_text(encoding="utf-8")
    + """
[[scene.effects]]
kind = "resonance"
frequency_hz = 100.0
damping_ratio = 0.02
mass_ratio = 0.1

[[scene.effects]]
kind = "adaptation"
passive = false
"""
)
LINES = VALID.split("\n")
SCRAPS = st.one_of(
    st.sampled_from(["[", "]", "[[", "{", "}", "=", '"', '"""', "'", "'''", "#", ".", ",", "\\", "\n", "\r", "-"]),
    st.sampled_from(["\0", "\x1b[2J", "é", "\ud800", "inf", "nan", "1e308", "5e-324", "true", "1979-05-27", "kind"]),
    st.sampled_from(["name = 1", "scene.effects = []", "[scene.effects]", "[[scene.effects]]", "[[device]]"]),
    st.text(max_size=5),
    st.sampled_from(LINES),
)


def faults_of(function, argument):
    """Return the faults, None where there are none; any other exception ends the test."""
    try:
        function(argument)
    except avc.InputError as error:
        return error.faults
    return None


def check(text):
    faults = faults_of(avc.parse_problem, text)
    assert faults is None or len(faults) > 0
    for fault in faults or ():
        assert fault.message
        assert str(fault).isprintable()
        assert fault.line is None or 1 <= fault.line <= text.count("\n") + 1


@pytest.mark.thorough
@settings(max_examples=400)
@given(st.data())
def test_random_edits_of_a_valid_file(data):
    text = VALID
    for _ in range(data.draw(st.integers(1, 4))):
        begin = data.draw(st.integers(0, len(text)))
        removed = data.draw(st.sampled_from([0, 0, 1, 3, 20, 200]))
        text = text[:begin] + data.draw(SCRAPS) + text[begin + removed :]
    check(text)


@settings(max_examples=200)
@given(st.lists(st.sampled_from(LINES), max_size=60))
def test_shuffled_lines_of_a_valid_file(lines):
    check("\n".join(lines))


@given(st.binary(max_size=200))
def test_random_bytes(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("bytes") / "random.toml"
    path.write_bytes(content)
    with pytest.raises(avc.InputError):
        avc.load_problem(path)


@given(st.text(max_size=40))
def test_random_names(name):
    faults = faults_of(avc.load_problem, name)
    assert faults is None or all(fault.message for fault in faults)


# Without the guards each of these takes minutes, or all memory.
@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(
    "text",
    [
        "a." * 500_000 + "a = 1",
        '"a" . ' * 150_000 + "a = 1",
        "[" + "a." * 500_000 + "a]",
        "a = " + "[" * 100_000,
        "a = " + "{a = " * 100_000,
        "a = " + "1" * 1_000_000,
        "a-" * 500_000 + ".",
        "x = '''" + "'\n" * 300_000 + "'''",
        "[[scene.effects]]\nkind = 'delya'\n" * 30_000,
        "".join(f"key{number} = 1\n" for number in range(60_000)),
        "[frequency]\nvalues_hz = [\n" + "'1',\n" * 150_000 + "]",
        "[frequency]\nvalues_hz = [\n" + "1,\n" * 300_000 + "]",
    ],
    ids=lambda text: text[:12],
)
def test_files_made_to_hang_are_refused(text):
    with pytest.raises(avc.InputError) as caught:
        avc.parse_problem(text)
    assert len(caught.value.faults) <= 1001


def refusal_of(source):
    with pytest.raises(avc.InputError) as caught:
        avc.load_problem(source)
    (fault,) = caught.value.faults
    return fault


def test_files_that_are_no_problem_files(tmp_path):
    assert "does not exist" in refusal_of(tmp_path / "none.toml").message
    assert "is a directory" in refusal_of(tmp_path).message
    assert "is a directory" in refusal_of(str(tmp_path)).message
    assert "is no path" in refusal_of("a\0b.toml").message
    (tmp_path / "empty.toml").write_bytes(b"")
    assert "is empty" in refusal_of(tmp_path / "empty.toml").message
    (tmp_path / "latin.toml").write_bytes("# first\ntitle = 'é'".encode("latin-1"))
    fault = refusal_of(tmp_path / "latin.toml")
    assert (fault.line, "0xe9 is not UTF-8" in fault.message) == (2, True)
    (tmp_path / "utf16.toml").write_bytes(VALID.encode("utf-16"))
    assert "not UTF-8" in refusal_of(tmp_path / "utf16.toml").message


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_a_pipe_that_nobody_writes_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    assert "no regular file" in refusal_of(tmp_path / "pipe.toml").message


def test_a_file_of_100_mb_is_refused_unread(tmp_path, monkeypatch):
    path = tmp_path / "large.toml"
    with path.open("wb") as file:
        file.truncate(100_000_000)
    monkeypatch.setattr("pathlib.Path.read_bytes", lambda _: pytest.fail("the file was read"))
    assert "has 100000000 bytes; allowed: at most 1048576" in refusal_of(path).message


def test_a_byte_order_mark_does_no_harm(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(VALID.encode("utf-8-sig"))
    assert avc.load_problem(path).name == "mine"


def test_an_unknown_name_lists_near_ones_and_the_next_step():
    fault = refusal_of("figur5")
    assert fault.file == "figur5"
    assert "figure5" in fault.message
    assert "avc list" in fault.message


def test_a_catalogue_name_wins_over_a_folder_of_that_name(tmp_path, monkeypatch):
    (tmp_path / "figure5").mkdir()
    monkeypatch.chdir(tmp_path)
    assert avc.load_problem("figure5").title == "Stiff virtual wall of figure 5"
    (tmp_path / "plain").write_text(VALID, encoding="utf-8")
    assert avc.load_problem("plain").name == "plain"
