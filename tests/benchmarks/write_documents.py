"""Write the keys of problem files, the levels of a certificate and the age of each study into the pages.

python tests/benchmarks/write_documents.py

Meanings of keys stay as written there. Overwrites problems/README.md, avc_casadi/claims/README.md and README.md beside
this file, and in them nothing but what stands between `<!-- keys: NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator
from pydantic_core import PydanticUndefined
from script_arguments import script_arguments
from studied import table

from avc_casadi.model import EFFECTS, METHODS
from avc_casadi.model.control_law import FILTERS, VELOCITIES
from avc_casadi.model.effects import Effect
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import coupling_name
from avc_casadi.present.rows.level_words import LEVEL_TEXTS

_HEAD = ("key", "unit", "default", "allowed", "meaning")


def meanings() -> dict[tuple[str, str, str], str]:
    """What the page says of each key, by heading, kind and key: that is written there, by hand."""
    found, heading, kind = {}, "", ""
    for line in PAGES["problem"].read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            heading, kind = line, ""
        elif line.startswith("| `"):
            first, *_, said = (cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1])
            kind = first if first.startswith("`kind") else kind
            found[heading, kind, first] = said
    return found


def validators(annotation: Any) -> Iterator[Any]:
    """The validators of quantities inside a type, in the order in which they stand."""
    for part in getattr(annotation, "__metadata__", ()):
        if isinstance(part, BeforeValidator):
            yield part.func
    for inner in get_args(annotation.__origin__ if get_origin(annotation) is Annotated else annotation):
        yield from validators(inner)


def models(annotation: Any) -> list[type[BaseModel]]:
    """The tables that a type names."""
    if annotation is Effect:
        return [one.keys for one in EFFECTS.values()]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    inner = (annotation.__origin__,) if get_origin(annotation) is Annotated else get_args(annotation)
    return [model for part in inner for model in models(part)]


def literals(annotation: Any) -> tuple[Any, ...]:
    """The words or numbers that a type allows by name."""
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    inner = get_args(annotation) if get_origin(annotation) in {Union, UnionType} else ()
    return tuple(value for part in inner for value in literals(part))


def allowed(annotation: Any) -> tuple[str, str]:
    """Unit of a key and what it allows."""
    if named := literals(annotation):
        return "", ", ".join(toml(value) for value in named)
    for part in validators(annotation):
        if part is coupling_name:
            return "", ", ".join(toml(value) for value in ("none", *METHODS))
    found = [part for part in validators(annotation) if hasattr(part, "allowed")]
    if not found:
        return "", "true, false" if annotation is bool else "text" if annotation is str else ""
    said, unit = found[0].allowed, getattr(getattr(found[0], "one", found[0]), "unit", "")
    pair = any(getattr(part, "__name__", "") == "_pair" for part in validators(annotation))
    return unit, f"[lowest, highest], each {said}" if pair else said


def toml(value: Any) -> str:
    """A default as it would stand in a file."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"' if value else ""
    if isinstance(value, tuple):
        return f"[{', '.join(toml(one) for one in value)}]"
    return "" if value is None else f"{value:g}"


def rows(model: type[BaseModel], prefix: str = "", place: tuple[str, str] = ("", "")) -> list[tuple[str, ...]]:
    """A row for each key of a table, meanings as they stand; tables inside it are written with dots."""
    found: list[tuple[str, ...]] = []
    said = meanings()
    for name, field in model.model_fields.items():
        metadata = tuple(part for part in field.metadata if isinstance(part, BeforeValidator))
        annotation = Annotated[field.annotation, *metadata] if metadata else field.annotation
        inner = models(annotation)
        if name == "kind" or len(inner) > 1:
            continue
        if len(inner) == 1:
            found += rows(inner[0], f"{prefix}{name}.", place)
            continue
        required = field.default is PydanticUndefined and field.default_factory is None
        unit, may = allowed(annotation)
        default = "required" if required else toml(field.default)
        key = f"`{prefix}{name}`"
        found.append((key, unit, default, may, said.get((*place, key), "")))
    return found


def kinds(field: str) -> list[type[BaseModel]]:
    """The tables among which `kind` chooses in [scene.motion] or [[scene.effects]]."""
    scene = Problem.model_fields["scene"].annotation
    assert scene is not None
    return models(scene.model_fields[field].rebuild_annotation())


def key_tables() -> str:
    """Every key of a problem file, a table for each table of the file."""
    parts = []
    written_tables = {model for field in Problem.model_fields.values() for model in models(field.annotation)[:1]}
    for name, field in Problem.model_fields.items():
        inner = models(field.annotation)
        if not inner:
            continue
        model = inner[0]
        said = (model.__doc__ or "").partition("\n")[0].rstrip(".")
        base = model.__bases__[0]
        inherited = base.model_fields if base in written_tables else {}  # stand in the table of that
        left = [row for row in rows(model, place=(f"### [{name}]", "")) if row[0][1:-1].split(".")[0] not in inherited]
        parts.append(f"### [{name}]\n\n{said.replace('|', chr(92) + '|')}.\n\n{table(_HEAD, left)}")
        if name == "device":
            parts[-1] += (
                "\n\nState all three keys of a table `resonance`, or leave the table out. The table `range` states "
                "how well each value of the device is known."
            )
        choices: dict[str, list[type[BaseModel]]] = {}
        if name == "scene":
            choices = {"[scene.motion]": kinds("motion"), "[[scene.effects]]": kinds("effects")}
        if name == "law":
            choices = {"[law.velocity]": [*VELOCITIES.values()], "[[law.filters]]": [*FILTERS.values()]}
        for title, alternatives in choices.items():
            place = f"### {title}"
            shared = rows(alternatives[0].__bases__[0], place=(place, ""))
            lines = [("of every kind", "", "", "", ""), *shared] if shared else []
            for one in alternatives:
                kind = one.model_fields["kind"].default
                what = (one.__doc__ or "").partition("\n")[0].rstrip(".").replace("|", "\\|")
                head = f'`kind = "{kind}"`'
                lines.append((head, "", "", "", f"**{what}**"))
                known = {row[0] for row in shared}
                lines += [row for row in rows(one, place=(place, head)) if row[0] not in known]
            parts.append(f"### {title}\n\n{table(_HEAD, lines)}")
    top = [row for row in rows(Problem, place=("## Every key", "")) if "." not in row[0] and row[0] != "`name`"]
    return "\n\n".join([table(_HEAD, top), *parts])


def levels_table() -> str:
    """The levels of a certificate, as their table says."""
    rows = [(name, text.claims, text.leaves) for name, text in LEVEL_TEXTS.items()]
    return table(("level", "claim, if it passes", "not covered"), rows)


ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "tests" / "benchmarks"
_EARLIER = {
    "0.2.0": {"e0094ee5", "25f7cfa"},
    "0.3.0": {"febdb0ac", "c2d6e515", "c5657f9e", "bb4f3d5e", "00b8b9e2", "8307d924", "0b71ddcc", "26f62a77"},
}
"""Commits of the package with which earlier releases were measured: a version alone does not say on which side."""
_MADE_BY = re.compile(r"^Made by `([^`]+)`(?:.*?package as of commit (\w+))?", re.MULTILINE)


def studies_table() -> str:
    """The command of each study, and the commit of the package that it measured, as its page or results file states."""
    rows, commands = [], set[str]()
    for page in sorted(STUDIES.glob("RESULTS_*.md")):
        for command, commit in _MADE_BY.findall(page.read_text(encoding="utf-8")) or [("", "")]:
            rows.append((f"[{page.stem.removeprefix('RESULTS_')}]({page.name})", command, commit))
            commands.add(command)
    for results in sorted((STUDIES / "results").glob("*.json")):
        made_by = json.loads(results.read_text(encoding="utf-8"))["about"]
        if made_by["command"] not in commands:
            rows.append((f"[{results.stem}](results/{results.name})", made_by["command"], made_by["commit"]))
    release_of = {commit: release for release, commits in _EARLIER.items() for commit in commits}
    head = ("study", "command", "package as of commit", "rules of release")
    return table(head, [_study_row(*study, release_of.get(study[-1], "0.4.0")) for study in rows])


def _study_row(study: str, command: str, commit: str, release: str) -> tuple[str, ...]:
    """A row of the table; some pages state neither command nor commit."""
    return study, f"`{command}`" if command else "on its page", commit or "not stated", release if commit else "-"


PAGES = {
    "problem": ROOT / "problems" / "README.md",
    "levels": ROOT / "avc_casadi" / "claims" / "README.md",
    "studies": STUDIES / "README.md",
}
WRITERS = {"problem": key_tables, "levels": levels_table, "studies": studies_table}


def written(name: str) -> str:
    """The page as it should stand."""
    begin, end = f"<!-- keys: {name} -->\n", "<!-- end -->"
    before, _, after = PAGES[name].read_text(encoding="utf-8").partition(begin)
    return f"{before}{begin}{WRITERS[name]()}\n{end}{after.partition(end)[2]}"


def main() -> None:
    script_arguments(__doc__)
    for name, page in PAGES.items():
        page.write_text(written(name), encoding="utf-8")


if __name__ == "__main__":
    main()
