"""Faults of a file's tables: pydantic's errors in plain words."""

from __future__ import annotations

import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ValidationError
from pydantic.fields import FieldInfo

from avc_casadi._util.units import LINEAR, ROTARY
from avc_casadi.model.effects import EffectTable
from avc_casadi.model.quantity import Finding, Path, in_another_unit, nearest_key, one_of, shown
from avc_casadi.model.registries import EFFECTS

_M = TypeVar("_M", bound=BaseModel)

UNKNOWN = "is not a known key; "
"""Beginning of the finding of a mistyped key."""
# Tables of the remote end, rare in files, whose keys others have too.
_SELDOM = {"simulation", "follower"}
# Largest number reported: a file of a million wrong numbers must be answered quickly too.
_MOST = 1000
# The file's own name is the name of the problem.
_NOT_A_KEY = "name"


def checked(model: type[_M], tables: Mapping[str, Any], name: str = "") -> _M | list[Finding]:
    """Return a file's parsed tables as a model, or all their faults; those between tables where each is sound."""
    keys = {key: value for key, value in tables.items() if key != _NOT_A_KEY}
    findings: list[Finding] = []
    if _NOT_A_KEY in tables:
        findings.append(((_NOT_A_KEY,), "is not a key; the file's own name is the name of the problem"))
    try:
        found = model.model_validate({**keys, _NOT_A_KEY: name} if _NOT_A_KEY in model.model_fields else keys)
    except ValidationError as error:
        findings += _findings(model, keys, list(_whole(error.errors(include_url=False))))
    else:
        if not findings:
            return found
    if len(findings) > _MOST:
        findings[_MOST:] = [((), f"has {len(findings) - _MOST} more faults")]
    return findings


def _findings(model: type[BaseModel], keys: Mapping[str, Any], items: Sequence[Any]) -> list[Finding]:
    """Return the faults; a key in another unit is one finding, together with the key meant."""
    found: list[tuple[str, Finding]] = []
    meant: set[Path] = set()
    units = ROTARY if _item(keys.get("device"), "motion") == "rotary" else LINEAR
    for item in items:
        # A default of the table that is at fault is no fault of its own.
        if item["type"] == "default_factory_not_called":
            continue
        path = _path(item["loc"])
        finding = _finding(model, keys, path, item) if len(found) < _MOST else (path, item["msg"])
        if item["type"] == "extra_forbidden" and len(found) < _MOST:
            known = {units.key(key): key for key in _keys(_models_at(model, keys, path[:-1]))}
            table: Any = keys
            for part in path[:-1]:
                table = _item(table, part)
            typed = str(path[-1])
            other = in_another_unit(units.key(typed), item["input"], known, units)
            if other and known[other[0]] not in table:
                meant.add((*path[:-1], known[other[0]]))
                finding = path, f"{UNKNOWN}write {other[1]}"
            elif ROTARY.inner(typed) in known:
                meant.add((*path[:-1], ROTARY.inner(typed)))
                finding = path, f'is a key of what turns, device.motion = "rotary"; allowed: {ROTARY.inner(typed)}'
        found.append((item["type"], finding))
    return [finding for kind, finding in found if kind != "missing" or finding[0] not in meant]


def _whole(items: Sequence[Any]) -> Iterator[Any]:
    """Yield the errors of nested tables, read by their own validator, each at its path."""
    for item in items:
        if item["type"] == "inner":
            yield from _whole([{**fault, "loc": (*item["loc"], *fault["loc"])} for fault in item["ctx"]["faults"]])
        else:
            yield item


def _path(location: Sequence[str | int]) -> Path:
    """Return pydantic's location without the kind that it adds for a motion."""
    kind = location.index("motion") + 1 if "motion" in location[1:] and "scene" in location else len(location)
    return (*location[:kind], *location[kind + 1 :])


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
    first = [f"{key} ({_values(models[0].model_fields[key])})" for key in needed]
    return f"a table with {', '.join([*first, *(key for key in _keys(models) if key not in needed)])}"


def _finding(whole: type[BaseModel], tables: Mapping[str, Any], path: Path, item: Any) -> Finding:
    fault, value = item["type"], item["input"]
    message: str = item["msg"]
    if fault == "missing":
        message = f"is missing; allowed: {_values(_models_at(whole, tables, path[:-1])[0].model_fields[str(path[-1])])}"
    elif fault == "extra_forbidden":
        own = _models_at(whole, tables, path[:-1])
        message = f"{UNKNOWN}allowed: {', '.join(_keys(own))}{_hint(whole, own, path)}"
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
    # A key with a word left out belongs to its own table, even if another table has a key of that name.
    if path[0] != "scene" and "range" not in path:
        inside = [f"[{table}.{name}]" for model in own for name in _tables_with(model, key)]
        having = [] if near and key in near else _tables_with(whole, key)
        # Rare tables are named only where no other table has the key.
        usual = [name for name in having if name not in _SELDOM] or having
        if others := inside or [f"[{name}]" for name in usual]:
            return f"; it belongs in {' or '.join(others)}"
    return f"; did you mean {near}?" if near else ""


def _tables_with(model: type[BaseModel], key: str) -> list[str]:
    """Return the tables of a model that have a key and are of one kind."""
    tables = {name: _models(field.annotation) for name, field in model.model_fields.items()}
    return [name for name, models in tables.items() if len(models) == 1 and key in _keys(models)]


def _values(field: FieldInfo) -> str:
    """Return the values allowed for a key."""
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
