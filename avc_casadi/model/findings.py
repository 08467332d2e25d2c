"""Faults of a file's tables: pydantic's errors in plain words, then the broken rules."""

from __future__ import annotations

import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ValidationError
from pydantic.fields import FieldInfo

from avc_casadi._util.units import LINEAR, ROTARY, spoken_key
from avc_casadi.model.effects import EffectTable
from avc_casadi.model.other_units import in_another_unit
from avc_casadi.model.quantity import nearest_key, one_of, shown
from avc_casadi.model.registries import EFFECTS
from avc_casadi.model.rules import BELONGS_IN, RULES, UNKNOWN, Finding, Path, Rule, Values, broken_rules

_M = TypeVar("_M", bound=BaseModel)

# Tables of the remote end, rare in files, whose keys others have too.
_SELDOM = {"simulation", "follower"}
# Largest number reported: a file of a million wrong numbers must be answered quickly too.
_MOST = 1000

# The file's own name is the name of the problem.
_NOT_A_KEY = "name"

# These only follow from another fault, which is reported at its own place.
_CONSEQUENCES = {"default_factory_not_called"}


def checked(model: type[_M], tables: Mapping[str, Any], name: str, rules: Sequence[Rule] = RULES) -> _M | list[Finding]:
    """Return a file's parsed tables as a model, or all their faults.

    Fields come first, then each rule between values wherever the values that it needs are sound, so that a
    fault in one place hides none in another.
    """
    keys = {key: value for key, value in tables.items() if key != _NOT_A_KEY}
    findings: list[Finding] = []
    if _NOT_A_KEY in tables:
        findings.append(((_NOT_A_KEY,), "is not a key; the file's own name is the name of the problem"))
    try:
        found = model.model_validate({**keys, _NOT_A_KEY: name} if _NOT_A_KEY in model.model_fields else keys)
    except ValidationError as error:
        items = [item for item in _whole(error.errors(include_url=False)) if item["loc"]]
        items = [item for item in items if item["type"] not in _CONSEQUENCES]
        paths = [_path(item["loc"]) for item in items]
        findings += _found(model, keys, paths[:_MOST], items)
        findings += broken_rules(Values(keys, model, set(paths)), rules)
    else:
        if not findings:
            return found
    if len(findings) > _MOST:
        findings[_MOST:] = [((), f"has {len(findings) - _MOST} more faults")]
    return findings


def _found(
    model: type[BaseModel], keys: Mapping[str, Any], paths: Sequence[Path], items: Sequence[Any]
) -> list[Finding]:
    """Return the faults by path; a key in another unit is one finding, together with the key meant."""
    findings, meant = [], set()
    for path, item in zip(paths, items, strict=False):
        finding = _finding(model, keys, path, item)
        if item["type"] == "extra_forbidden":
            units = ROTARY if _item(keys.get("device"), "motion") == "rotary" else LINEAR
            known = {units.key(key): key for key in _keys(_models_at(model, keys, path[:-1]))}
            other = in_another_unit(str(path[-1]), item["input"], known)
            table: Any = keys
            for part in path[:-1]:
                table = _item(table, part)
            if other and known[other[0]] not in table:
                meant.add((*path[:-1], known[other[0]]))
                finding = path, f"is not a known key; write {other[1]}"
        findings.append((item["type"], finding))
    return [finding for kind, finding in findings if kind != "missing" or finding[0] not in meant]


def _whole(items: Sequence[Any]) -> Iterator[Any]:
    """Yield the errors of nested tables, read by their own validator, each at its path."""
    for item in items:
        if item["type"] == "inner":
            yield from ({**fault, "loc": (*item["loc"], *fault["loc"])} for fault in item["ctx"]["faults"])
        else:
            yield item


def _path(location: Sequence[str | int]) -> Path:
    """Return pydantic's location without the kind that it adds for a motion."""
    if location[:2] == ("scene", "motion"):
        return (*location[:2], *location[3:])
    return tuple(location)


def _item(node: Any, part: str | int) -> Any:
    if isinstance(part, int):
        return node[part] if isinstance(node, list) else None
    return node.get(part) if isinstance(node, Mapping) else None


def _models(annotation: Any) -> list[type[BaseModel]]:
    """Return the tables that an annotation allows."""
    if annotation is EffectTable:
        return [one.keys for one in EFFECTS.values()]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in typing.get_args(annotation) for model in _models(inner)]


def _models_at(whole: type[BaseModel], tables: Mapping[str, Any], path: Path) -> list[type[BaseModel]]:
    """Return the tables allowed at a path: one, or one for each kind."""
    models = [whole]
    node: Any = tables
    for part in path:
        node = _item(node, part)
        if isinstance(part, str):
            models = _models(models[0].model_fields[part].annotation)
        if isinstance(node, Mapping):
            models = [m for m in models if "kind" in node and _kind(m) == node["kind"]] or models
    return models


def _kind(model: type[BaseModel]) -> Any:
    field = model.model_fields.get("kind")
    return field and field.default


def _keys(models: list[type[BaseModel]]) -> list[str]:
    if len(models) > 1:
        return ["kind"]
    return [key for key in models[0].model_fields if key != _NOT_A_KEY]


def _table(models: list[type[BaseModel]]) -> str:
    """Return the keys of a table: required ones with their values, then the rest."""
    needed = [key for key in _keys(models)[:20] if len(models) == 1 and models[0].model_fields[key].is_required()]
    told = [f"{spoken_key(key)} ({_values(models[0].model_fields[key])})" for key in needed]
    rest = [key for key in _keys(models) if key not in needed]
    return f"a table with {', '.join([*told, *map(spoken_key, rest)])}"


def _finding(whole: type[BaseModel], tables: Mapping[str, Any], path: Path, item: Any) -> Finding:
    fault, value = item["type"], item["input"]
    message: str = item["msg"]
    if fault == "missing":
        message = f"is missing; allowed: {_allowed(whole, tables, path)}"
    elif fault == "extra_forbidden":
        own = _models_at(whole, tables, path[:-1])
        message = f"{UNKNOWN}{', '.join(map(spoken_key, _keys(own)))}{_hint(whole, own, path)}"
    elif fault in {"model_type", "model_attributes_type"}:
        message = f"is {shown(value)}, not a table; allowed: {_table(_models_at(whole, tables, path))}"
    elif fault in {"union_tag_invalid", "union_tag_not_found"}:
        kinds = [_kind(model) for model in _models_at(whole, tables, path)]
        what = f"is {shown(value['kind'])}" if "kind" in value else "is missing"
        path, message = (*path, "kind"), f"{what}; allowed: {one_of(kinds, value.get('kind'))}"
    elif fault == "literal_error":
        annotation = _models_at(whole, tables, path[:-1])[0].model_fields[str(path[-1])].annotation
        message = f"is {shown(value)}; allowed: {one_of(list(typing.get_args(annotation)), value)}"
    elif fault == "bool_type":
        message = f"is {shown(value)}; allowed: true or false"
    return path, message


def _hint(whole: type[BaseModel], own: list[type[BaseModel]], path: Path) -> str:
    """Return which tables have a key, or a similar key of its own table; effects have messages of their own."""
    key, table, keys = str(path[-1]), ".".join(map(str, path[:-1])), _keys(own)
    near = nearest_key(key, keys)
    if path[0] != "scene" and "range" not in path:
        inside = [f"[{table}.{name}]" for model in own for name in _tables_with(model, key)]
        # A key with a word left out belongs to its own table, even if another table has a key of that name.
        left_out = near and key in near
        having = [] if left_out else _tables_with(whole, key)
        # Rare tables are named only where no other table has the key.
        usual = [name for name in having if name not in _SELDOM] or having
        others = inside or [f"[{name}]" for name in usual]
        if others:
            return f"{BELONGS_IN}{' or '.join(others)}"
    return f"; did you mean {spoken_key(near)}?" if near else ""


def _tables_with(model: type[BaseModel], key: str) -> list[str]:
    """Return the tables of a model that have a key and are of one kind."""
    tables = {name: _models(field.annotation) for name, field in model.model_fields.items()}
    return [name for name, models in tables.items() if len(models) == 1 and key in _keys(models)]


def _allowed(whole: type[BaseModel], tables: Mapping[str, Any], path: Path) -> str:
    """Return the values allowed for a missing key."""
    return _values(_models_at(whole, tables, path[:-1])[0].model_fields[str(path[-1])])


def _values(field: FieldInfo) -> str:
    for mark in (*field.metadata, *_marks(field.annotation)):
        if isinstance(mark, BeforeValidator) and (allowed := getattr(mark.func, "allowed", "")):
            return str(allowed)
    inner = _models(field.annotation)
    return _table(inner) if inner else "text in quotation marks"


def _marks(annotation: Any) -> Iterator[Any]:
    """Yield the metadata of an annotation and of those inside it."""
    yield from getattr(annotation, "__metadata__", ())
    for inner in typing.get_args(annotation):
        yield from _marks(inner)
