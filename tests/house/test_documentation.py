"""Pages: their code blocks run as they stand, in their order and in one folder; links lead on; tables are generated.

What a comment above exempts (`not run: REASON`) is parsed: its verbs and options exist.
"""

import re
import shlex

import pytest
from documentation import PAGES, Block, anchors, blocks, links, shown
from write_documents import PAGES as WRITTEN
from write_documents import key_tables, written

import avc_casadi
from avc_casadi.cli import build_parser, main
from avc_casadi.recommendation import recommend as answering

# The README first: what it writes, others read.
ORDER = sorted((page for page in PAGES if not page.name.startswith("RESULTS")), key=lambda page: len(page.parts))


def runnable(block: Block) -> bool:
    return block.language in {"sh", "python"} and not block.mark.startswith(("not run: ", "test command"))


RUN = [page for page in ORDER if any(map(runnable, blocks(page)))]


def commands(text):
    """The `avc` commands of a shell block, each as a list of words."""
    words = (shlex.split(part, comments=True) for line in text.splitlines() for part in re.split(r"; (?=avc )", line))
    return [found[1:] for found in words if found[:1] == ["avc"]]


@pytest.fixture
def once(monkeypatch):
    """One recommendation serves all blocks that ask for the same."""
    whole = answering.recommend

    answers = {}

    def recommend(problem, hands=100, seed=0, *, lean_on_friction=False, prove=False, **told):
        settled = avc_casadi.load_problem(problem) if isinstance(problem, str) else problem
        options = {"hands": hands, "seed": seed, "lean_on_friction": lean_on_friction, "prove": prove}
        asked = (avc_casadi.dump_problem(settled), *options.values())
        if asked not in answers:
            answers[asked] = whole(settled, **options, **told)
        return answers[asked]

    monkeypatch.setattr(answering, "recommend", recommend)
    monkeypatch.setitem(avc_casadi.__dict__, "recommend", recommend)


@pytest.mark.slow
@pytest.mark.usefixtures("once")
def test_blocks_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    said = {}
    for page in RUN:
        names = {}
        for block in blocks(page):
            if block.mark.startswith("file: "):
                tmp_path.joinpath(block.mark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
            if block.mark.startswith("output: avc "):
                assert_said(block, said[block.mark.removeprefix("output: avc ")])
            if runnable(block):
                said |= run(block, names, capsys)


def assert_said(block, said):
    """Each line of the block begins a line of the answer; numbers may differ by a hundredth."""
    number = re.compile(r"\d+(?:\.\d+)?(?:e[+-]\d+)?")
    lines = said.splitlines()
    for line in block.text.splitlines():
        words = number.sub("#", line)
        found = next((one for one in lines if number.sub("#", one).startswith(words)), None)
        assert found is not None, (block.page, line)
        pairs = zip(number.findall(line), number.findall(found), strict=False)
        assert all(float(told) == pytest.approx(float(is_now), rel=0.01) for told, is_now in pairs), (line, found)


def run(block, names, capsys):
    """Run a block; returns what each of its commands said."""
    place = f"{block.page}:{block.line}"
    if block.language == "python":
        exec(compile(block.text, place, "exec"), names)  # noqa: S102
        return {}
    found = commands(block.text)
    assert len(found) == len(re.findall(r"^avc |; avc ", block.text, re.MULTILINE)), place
    last = int(block.mark.removeprefix("ends with ")) if block.mark.startswith("ends with ") else 0
    outputs = {}
    for words, wanted in zip(found, [0] * (len(found) - 1) + [last], strict=True):
        code = main(words)
        said = capsys.readouterr()
        assert (code, bool(said.out)) == (wanted, True), (place, words, said.err)
        outputs[" ".join(words)] = said.out
    for line in block.text.splitlines():
        command, _, comment = line.partition(" #")
        if command.startswith("avc ") and len(commands(command)) == 1:
            assert_holds(outputs[" ".join(commands(command)[0])], comment, place)
    return outputs


def assert_holds(said, comment, place):
    """The answer has each number of three or more digits that a comment beside its command has."""
    for number in re.findall(r"-?\d+(?:\.\d+)?", comment):
        if len(re.sub(r"[-.]", "", number).lstrip("0")) >= 3:
            assert number in said, (place, number, said)


@pytest.mark.parametrize(
    "block",
    [block for page in ORDER for block in blocks(page) if block.language == "sh" and not runnable(block)],
    ids=lambda block: f"{block.page}:{block.line}",
)
def test_exempt_commands_exist(block: Block):
    for words in commands(block.text):
        build_parser().parse_args(words)


# Every relative link of every page leads to a file, and to a heading of it where it names one.


# What a release linked to may have gone since.
@pytest.mark.parametrize("page", PAGES, ids=shown)
def test_links_lead_somewhere(page):
    lost = []
    for link in links(page):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        place, _, anchor = link.partition("#")
        target = (page.parent / place).resolve() if place else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            lost.append(link)
    assert not lost


# Generated blocks of the pages are what the model of a problem file gives.


@pytest.mark.parametrize("name", WRITTEN)
def test_blocks_are_up_to_date(name):
    assert WRITTEN[name].read_text(encoding="utf-8") == written(name), "python tests/benchmarks/write_documents.py"


def test_every_key_has_a_meaning():
    rows = [line.split(" | ") for line in key_tables().splitlines() if line.startswith("| `")]
    assert len(rows) > 100
    assert not [row[0] for row in rows if row[-1].strip(" |") == "" and "`range." not in row[0]]
