"""The API reference: every public name of every room, from its signature and its docstring."""

from __future__ import annotations

import ast
import inspect
import re
from importlib import import_module
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).parents[1]
# No calls of theirs are meant for users.
_INSIDE = {"_problems", "_util", "cli", "docs", "report"}
ROOMS = (
    "avc_casadi",
    *sorted(
        ".".join(("avc_casadi", *path.parent.relative_to(_PACKAGE).parts))
        for path in _PACKAGE.glob("*/**/__init__.py")
        if not _INSIDE & set(path.parent.relative_to(_PACKAGE).parts)
    ),
    "avc_hardware",
)
_SECTIONS = ("Args", "Attributes", "Returns", "Raises", "Yields", "Example")


def write_api(folder: Path) -> None:
    """Write a page for each room into a folder."""
    folder.mkdir()
    for room in ROOMS:
        (folder / f"{room}.md").write_text(page_of(room), encoding="utf-8")


def page_of(room: str) -> str:
    """The page of one room in Markdown."""
    module = import_module(room)
    parts = [f"# {room}", prose(inspect.getdoc(module) or "")]
    parts += [entry(name, thing) for name, thing in public_names(module)]
    return "\n\n".join(part for part in parts if part) + "\n"


def public_names(room: Any) -> list[tuple[str, Any]]:
    """What a room offers: its `__all__`, what it gives out, or the classes and functions of its modules."""
    if hasattr(room, "__all__"):
        return [(name, getattr(room, name)) for name in sorted(room.__all__, key=str.lower)]
    source = inspect.getsource(room)
    given = re.findall(r"^\s*from \S+ import \w+ as (\w+)$", source, re.MULTILINE)
    if given:
        return [(name, getattr(room, name)) for name in sorted(set(given), key=str.lower)]
    found = []
    for path in sorted(Path(inspect.getfile(room)).parent.glob("[!_]*.py")):
        module = import_module(f"{room.__name__}.{path.stem}")
        found += [
            (f"{path.stem}.{node.name}", getattr(module, node.name))
            for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_")
        ]
    return found


def entry(name: str, thing: Any) -> str:
    """Heading, signature and docstring of one public name."""
    if inspect.ismodule(thing):
        return f"## {escaped(name)}\n\nA room of its own."
    told = inspect.getdoc(thing) if inspect.isclass(thing) or inspect.isroutine(thing) else ""
    parts = [f"## {escaped(name)}", f"```python\n{signature(name, thing)}\n```", prose(told or "")]
    if inspect.isclass(thing):
        for member, method in sorted(vars(thing).items()):
            shown = method.fget if isinstance(method, property) else getattr(method, "__func__", method)
            if member.startswith("_") or not inspect.isfunction(shown) or not shown.__doc__:
                continue
            head = member if isinstance(method, property) else signature(member, shown)
            parts += [f"**{escaped(member)}**", f"```python\n{head}\n```", prose(inspect.getdoc(shown) or "")]
    return "\n\n".join(part for part in parts if part)


def signature(name: str, thing: Any) -> str:
    """The call as it is typed; a constant's value, if it is short."""
    if inspect.isclass(thing) or inspect.isroutine(thing):
        try:
            return f"{name}{inspect.signature(thing)}"
        except (TypeError, ValueError):
            return f"{name}(...)"
    value = repr(thing)
    return f"{name} = {value}" if len(value) < 200 else f"{name}: {type(thing).__name__}"


def prose(docstring: str) -> str:
    """A Google docstring as Markdown: sections become lists, examples code."""
    parts: list[str] = []
    for section, lines in sections(docstring):
        text = "\n".join(lines).strip("\n")
        if not text:
            continue
        if section == "Example":
            parts.append(f"Example:\n\n```python\n{inspect.cleandoc(text)}\n```")
        elif section:
            parts.append(f"*{section}*\n\n{items(text)}")
        else:
            parts.append(paragraphs(text))
    return "\n\n".join(parts)


def sections(docstring: str) -> list[tuple[str, list[str]]]:
    """The parts of a docstring by their titles; the first has none."""
    found: list[tuple[str, list[str]]] = [("", [])]
    for line in docstring.splitlines():
        title = line.strip().removesuffix(":")
        if line and not line[0].isspace() and line.endswith(":") and title in _SECTIONS:
            found.append((title, []))
        else:
            found[-1][1].append(line)
    return found


def items(text: str) -> str:
    """Entries of a section as a list."""
    entries = re.split(r"\n(?=\S)", inspect.cleandoc(text))
    return "\n".join(f"- {escaped(' '.join(one.split()))}" for one in entries)


def paragraphs(text: str) -> str:
    """Prose; what is indented is code."""
    blocks = re.split(r"\n\s*\n", text)
    told = [f"```text\n{block}\n```" if block.startswith("    ") else escaped(block) for block in blocks if block]
    return "\n\n".join(told)


def escaped(text: str) -> str:
    """Text in which nothing is taken for Markdown but code between backticks."""
    parts = re.split(r"(``[^`]*``|`[^`]*`)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([\\*_\[\]<>{}$#|])", r"\\\1", part) for part in parts)
