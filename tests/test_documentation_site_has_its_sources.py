"""The sources of the site hold together without building it: cells, names, pages and the API reference."""

import ast
import re
import runpy
import sys
from importlib import import_module

import pytest
from documentation import ROOT, SITE

DOCS = ROOT / "avc_casadi" / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.md"))


@pytest.fixture
def _scripts(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))


def cells(path):
    return re.findall(r"^```\{code-cell\}\n(.*?)^```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("tutorial", TUTORIALS, ids=lambda path: path.stem)
def test_cells_are_python_with_names_that_exist(tutorial):
    found = cells(tutorial)
    assert len(found) >= 2
    for node in (node for cell in found for node in ast.walk(ast.parse(cell))):
        if isinstance(node, ast.ImportFrom):
            module = import_module(node.module)
            assert all(hasattr(module, alias.name) for alias in node.names), ast.unparse(node)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) in {"avc", "avc_hardware"}:
            module = import_module({"avc": "avc_casadi"}.get(node.value.id, node.value.id))
            assert hasattr(module, node.attr), node.attr


@pytest.mark.usefixtures("_scripts")
def test_the_index_lists_every_page():
    listed = set(
        re.findall(r"^((?:tutorials|guide|api)/\S+)$", (DOCS / "index.md").read_text(encoding="utf-8"), re.MULTILINE)
    )
    guide = import_module("guide_pages").every_page(ROOT)
    wanted = {f"tutorials/{path.stem}" for path in TUTORIALS}
    wanted |= {f"guide/{name}" for name in guide.values() if not name.startswith(("results-", "room-"))}
    assert listed == wanted | {"guide/results-*", "guide/room-*", "api/*"}
    assert {path.relative_to(ROOT).as_posix() for path in (ROOT / "avc_casadi").rglob("README.md")} <= set(guide)


@pytest.mark.usefixtures("_scripts")
def test_guide_pages_lead_to_each_other(tmp_path):
    pages = import_module("guide_pages")
    pages.write_guide(tmp_path / "guide", ROOT)
    written = {path.name for path in (tmp_path / "guide").iterdir()}
    for path in (tmp_path / "guide").glob("*.md"):
        plain = re.sub(r"^```.*?^```$|`[^`\n]*`", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        local = [link for link in re.findall(r"\]\(([^)\s#]+)", plain) if not link.startswith("http")]
        assert set(local) <= written, path.name


@pytest.mark.usefixtures("_scripts")
def test_api_reference_tells_every_public_name():
    api = import_module("api_pages")
    assert {"avc_casadi.claims", "avc_casadi.model", "avc_casadi.claims.prove", "avc_hardware"} <= set(api.ROOMS)
    page = api.page_of("avc_casadi")
    assert all(f"## {name}" in page.replace("\\", "") for name in import_module("avc_casadi").__all__)
    assert "## deployable.Deployable" in api.page_of("avc_casadi.claims")


def test_the_command_explains_itself(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(DOCS))
    monkeypatch.setattr(sys, "argv", ["build.py", "--help"])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(DOCS / "build.py"), run_name="__main__")
    assert end.value.code == 0
    assert "Overwrites OUT" in capsys.readouterr().out
    assert SITE
