"""No text that reaches exported C becomes code, and two exported couplings link into one program.

What a compiler makes of the text is told by the phases of the C standard, written here once more: trigraphs, lines that
go on, then comments. What is left must be the code of a coupling with plain names.
"""

import dataclasses
import re
import tempfile
from pathlib import Path

import pytest
from exported import C99, WARNINGS
from hardware_bench import bench_problem, export_c, require, run, scratch, with_gains
from hypothesis import example, given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi import InputError
from avc_casadi.coupling import Coupling

PLAIN = with_gains(bench_problem((5.0, 5e3), max_force_n=8.0), 5.0, 4e3, 3.0)
TRIGRAPHS = {f"??{last}": meant for last, meant in zip("/=()'<!>-", "\\#[]^{|}~", strict=True)}
# A comment, or a string that holds no comment.
TOKEN = re.compile(r'"(?:\\.|[^"\\\n])*"|/\*.*?\*/|//[^\n]*', re.DOTALL)
HARD = ["*/", "/*", "*\\", "\\", "\n", "??/", "//", "\u2028", "\u202e", "{id}", "%s", '"']
# A problem takes no control characters; what else is read from files may hold any.
WHOLE = st.text(st.characters(exclude_categories=("Cc", "Cs")), max_size=4)
TEXTS = st.lists(st.sampled_from(HARD) | WHOLE, max_size=8).map("".join)
ANY = st.lists(st.sampled_from([*HARD, "\r", "\0"]) | st.text(max_size=4), max_size=8).map("".join)


def code(text: str) -> str:
    """What is left of C without its comments: of each line what stands between blanks."""
    for trigraph, character in TRIGRAPHS.items():
        text = text.replace(trigraph, character)
    joined = re.sub(r"\\[ \t]*\r?\n", "", text)
    bare = TOKEN.sub(lambda found: found[0] if found[0].startswith('"') else " ", joined)
    return " ".join(bare.split())


def named(title: str, method: str, file: str) -> dict[str, str]:
    """The exported files of the plain coupling under other names, as text by path."""
    other = PLAIN.problem.model_copy(update={"title": title, "name": file})
    return export_c(dataclasses.replace(by(method), problem=other))


def by(method: str) -> Coupling:
    return dataclasses.replace(PLAIN, schedule=dataclasses.replace(PLAIN.schedule, method=method))


@pytest.mark.thorough
@given(title=TEXTS, method=ANY, file=TEXTS)
@example(title="*\\ int planted; /*", method="*/", file="??/\n*/")
@example(title="*\\/ int planted; /\\*", method="*?\u200b?//", file="\\")
def test_no_title_method_or_file_becomes_code(title: str, method: str, file: str) -> None:
    found, plain = named(title, method, file), named("a wall", "by hand", "bench")
    assert found.keys() == plain.keys()
    for place, text in found.items():
        assert text.isascii()
        assert code(text) == code(plain[place]), place


def test_a_planted_statement_is_seen_by_this_test() -> None:
    """A comment that ends early is code to `code`, in each way that C knows."""
    for text in ("/* a */ int planted; /* */", "/* a *??/\n/ int planted; /* */", "/* a *\\\n/ int planted; /* */"):
        assert code(text) == "int planted;"
    assert code('/* a */ char *text = "/* no comment */";') == 'char *text = "/* no comment */";'


MAIN = """
#include "soft.h"
#include "stiff.h"
#include <stdio.h>
int main(void)
{
    soft_t one;
    stiff_t other;
    soft_start(&one);
    stiff_start(&other);
    double soft = 0.0, stiff = 0.0;
    for (int k = -5; k <= 5; k++) {
        soft = (double)soft_step(&one, (soft_real_t)k * (soft_real_t)SOFT_SAMPLE_TIME_S * (soft_real_t)0.1f);
        stiff = (double)stiff_step(&other, (stiff_real_t)k * (stiff_real_t)STIFF_SAMPLE_TIME_S * (stiff_real_t)0.1f);
    }
    printf("%a %a %s\\n", soft, stiff, SOFT_ID);
    return 0;
}
"""


def test_two_couplings_of_two_names_link_into_one_program() -> None:
    require("gcc")
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    gains = {"soft": with_gains(PLAIN.problem, 5.0, 1e3), "stiff": with_gains(PLAIN.problem, 5.0, 4e3)}
    for name, coupling in gains.items():
        for file, text in export_c(coupling, name=name).items():
            (folder / file).write_text(text, encoding="ascii")
    (folder / "main.c").write_text(MAIN, encoding="ascii")
    tool, *options = C99
    sources = [str(folder / file) for file in ("main.c", "soft.c", "stiff.c")]
    run(tool, *options, *WARNINGS, f"-I{folder}", *sources, "-o", str(folder / "both"))
    soft, stiff, told = run(str(folder / "both")).decode().split()
    assert 0 < float.fromhex(soft) < float.fromhex(stiff) <= 8
    assert told == gains["soft"].id
    assert not any("avc_coupling" in text for text in export_c(PLAIN, name="soft").values())


@pytest.mark.parametrize("name", ["", "Soft", "2nd", "a b", "a*/", "x" * 21, "soft_", "int main"])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="name: is "):
        export_c(PLAIN, name=name)


def test_a_file_with_a_planted_method_exports_as_any_other(tmp_path: Path) -> None:
    path = tmp_path / "coupling.json"
    avc.write_coupling(by("*\\ __attribute__((constructor)) void f(void){} /*"), path)
    assert code(export_c(avc.read_coupling(path))["avc_coupling.h"]) == code(export_c(PLAIN)["avc_coupling.h"])
