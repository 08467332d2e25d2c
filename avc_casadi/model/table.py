"""Tables of a file as pydantic models, and their faults in plain words: all at once, each at its path."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Self, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import LINEAR, Units
from avc_casadi.model.annotation import choices_of, inside, tables_of
from avc_casadi.model.near_key import Hint, KeysOf, hint_of

Path = tuple[str | int, ...]
Finding = tuple[Path, str]
"""Where a fault is, and what it is."""

UNKNOWN = "is not a known key; "
"""Beginning of the finding of a mistyped key."""
_ALLOWED = {"bool_type": "true or false", "tuple_type": "a list", "dict_type": "a table"}


class Table(BaseModel):
    """A frozen table: unknown keys, wrong types and non-finite numbers are refused, then what `faults` yields."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)

    def __init__(self, **keys: Any) -> None:
        try:
            super().__init__(**keys)
        except ValidationError as error:
            raise refused(faults_of(error), "") from None

    # A table inside another one is then read without a call, and the outer one has the faults of both.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="wrap")
    @classmethod
    def _read(cls, value: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        if isinstance(value, cls):
            return value
        findings: list[Finding] = []
        hints: dict[str, Hint] = {}
        table = value
        if isinstance(value, Mapping) and cls.model_config["extra"] == "forbid":
            table = {key: item for key, item in value.items() if key in cls.model_fields}
            # A million wrong keys are answered quickly too.
            unknown = [key for key in list(value)[: len(cls.model_fields) + 100] if key not in table]
            hints = {key: hint_of(cls, info.context, key, value[key]) for key in unknown}
            findings = [((key,), _unknown(cls, hint)) for key, hint in hints.items()]
        try:
            read = handler(table)
        except ValidationError as error:
            # A key that an unknown one stands for is not missing as well.
            meant = {(hint.key,) for hint in hints.values()}
            findings += (
                (path, message)
                for path, message in _findings(cls, error, value)
                if path not in meant or path[0] in table
            )
            findings += cls.stated_faults(table) if isinstance(table, Mapping) else ()
            raise inner_faults(findings) from None
        findings = findings or list(read.faults())
        if findings:
            raise inner_faults(findings)
        return read

    def faults(self) -> Iterator[Finding]:
        """Yield what is wrong between values that are each allowed."""
        yield from ()

    @classmethod
    def stated_faults(cls, table: Mapping[str, Any]) -> Iterator[Finding]:  # noqa: ARG003 - most tables have none
        """Yield what of `faults` shows in what is stated, where other values are refused."""
        yield from ()


def inner_faults(findings: list[Finding]) -> PydanticCustomError:
    """Return the error of several faults, each at its path in what is read."""
    text = "\n".join(f"{dotted(path)}: {message}" for path, message in findings)
    return PydanticCustomError("inner", "{text}", {"text": text, "faults": findings})


def checked(
    model: type[M], tables: Mapping[str, Any], name: str = "", units: tuple[Units, ...] = (LINEAR,)
) -> M | list[Finding]:
    """Return a file's parsed tables as a model, or all their faults; those between tables where each is sound.

    `units` are those of its keys, for hints.
    """
    keys = {key: value for key, value in tables.items() if key != "name"}
    is_no_key = "is not a key; leave it out: the name of the file is the name of the problem"
    findings: list[Finding] = [(("name",), is_no_key)] if "name" in tables else []
    try:
        read = model.model_validate(
            {**keys, "name": name} if "name" in model.model_fields else keys, context=KeysOf(model, units)
        )
    except ValidationError as error:
        return findings + faults_of(error)
    return findings or read


def of_kinds(value: Any, kinds: Mapping[str, type[Table]], name: str, most: int) -> tuple[Any, ...]:
    """Return a list of tables, each read by the keys of its kind; all faults are reported at once."""
    if not isinstance(value, list | tuple) or len(value) > most:
        raise refusal(f"is {shown(value)}; allowed: a list of tables {name}, {most} at most")
    tables: list[Any] = []
    faults: list[Finding] = []
    for index, entry in enumerate(value):
        kind = entry.get("kind") if isinstance(entry, Mapping) else None
        if isinstance(entry, tuple(kinds.values())):
            tables.append(entry)
        elif not isinstance(entry, Mapping):
            faults.append(((index,), f"is {shown(entry)}, not a table; allowed: a table with kind"))
        elif not isinstance(kind, str) or kind not in kinds:
            fault = "is missing" if kind is None else f"is {shown(kind)}"
            faults.append(((index, "kind"), f"{fault}; allowed: {one_of(kinds, kind)}"))
        else:
            try:
                tables.append(kinds[kind].model_validate(entry))
            except ValidationError as error:
                faults += [((index, *path), message) for path, message in faults_of(error)]
    if faults:
        raise inner_faults(faults)
    return tuple(tables)


def refused(findings: Iterable[Finding], file: str) -> InputError:
    """Return the error of findings that stand on no line."""
    return InputError([Fault(file, None, dotted(path), message) for path, message in findings])


def valid(model: type[M], tables: Mapping[str, Any], file: str, name: str = "") -> M:
    """Return tables as a model, or raise all their faults."""
    read = checked(model, tables, name)
    if isinstance(read, list):
        raise refused(read, file)
    return read


def faults_of(error: ValidationError) -> list[Finding]:
    """Return the faults of a table that was refused."""
    return [fault for item in error.errors(include_url=False) for fault in item["ctx"]["faults"]]


def _findings(table: type[Table], error: ValidationError, value: Any) -> Iterator[Finding]:
    """Yield the faults of a table's own keys, and those that its inner tables told of theirs."""
    for item in error.errors(include_url=False):
        path: Path = item["loc"]
        kind = item["type"]
        typed: Any = item["input"]
        if kind == "inner":
            field = table.model_fields[str(path[0])]
            path = path[:1] if field.discriminator is not None else path  # pydantic adds the kind of a table
            yield from (((*path, *inner), message) for inner, message in item["ctx"]["faults"])
        elif kind == "missing":
            yield path, f"is missing; allowed: {_values(table.model_fields[str(path[0])])}"
        elif kind in {"model_type", "model_attributes_type"}:
            # Of a table that is one of several kinds pydantic reports it at the key, of any other in the table.
            allowed = _values(table.model_fields[str(path[0])]) if path else _keys(table)
            yield path, f"is {shown(typed if path else value)}, not a table; allowed: {allowed}"
        elif kind in {"union_tag_invalid", "union_tag_not_found"}:
            tables = tables_of(table.model_fields[str(path[0])].annotation, Table)
            choices = [alternative.model_fields["kind"].default for alternative in tables]
            typed = typed.get("kind")
            fault = "is missing" if typed is None else f"is {shown(typed)}"
            yield (*path, "kind"), f"{fault}; allowed: {one_of(choices, typed)}"
        elif kind == "literal_error":
            choices = choices_of(table.model_fields[str(path[0])].annotation)
            yield path, f"is {shown(typed)}; allowed: {one_of(choices, typed)}"
        elif kind != "default_factory_not_called":  # a default of a table that is at fault is no fault of its own
            yield path, f"is {shown(typed)}; allowed: {_ALLOWED[kind]}" if kind in _ALLOWED else item["msg"]


def _unknown(table: type[Table], hint: Hint) -> str:
    """Return the fault of a key that a table of a file has not, with what is meant if anything is near."""
    known = ", ".join(name for name in table.model_fields if name != "name")
    return f"{UNKNOWN}allowed: {known}{f'; did you mean {hint.text}?' if hint.text else ''}"


def _keys(table: type[Table]) -> str:
    """Return the keys of a table, the required ones with their values."""
    keys = (
        f"{key} ({_values(field)})" if field.is_required() else key
        for key, field in table.model_fields.items()
        if key != "name"
    )
    return f"a table with {', '.join(keys)}"


def _values(field: FieldInfo) -> str:
    """Return the values allowed for a key."""
    for mark in (*field.metadata, *inside(field.annotation)):
        if isinstance(mark, BeforeValidator) and (allowed := getattr(mark.func, "allowed", "")):
            return str(allowed)
    inner = tables_of(field.annotation, Table)
    if field.discriminator is not None:
        kinds = one_of((kind.model_fields["kind"].default for kind in inner), None)
        return f"a table {{ kind = KIND, ... }} with KIND one of {kinds}"
    if inner:
        return _keys(inner[0])
    return ", ".join(map(shown, choices_of(field.annotation))) or "text in quotation marks"


def dotted(path: Path) -> str:
    """Return a path as in a file: ``scene.effects[0].mass_kg``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if re.fullmatch("[A-Za-z0-9_-]{1,60}", part) else f".{shown(part)}"
    return text.removeprefix(".")


def refusal(text: str) -> PydanticCustomError:
    """Return the error that a validator raises; `text` reaches the user unchanged."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def visible(text: str) -> str:
    """Return a text of the file, shortened, with control and invisible characters escaped."""
    marks = [mark if mark.isprintable() else f"\\u{ord(mark):04x}" for mark in text[:60]]
    return "".join(marks) + ("..." if len(text) > 60 else "")


def shown(value: object) -> str:
    """Return a value as in the file, shortened."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping | BaseModel):
        return "a table"
    if isinstance(value, str):
        return f'"{visible(value)}"'
    if isinstance(value, int) and abs(value) >= 10**60:
        return "an integer of more than 60 digits"
    if isinstance(value, list | tuple):
        return visible(f"[{', '.join(shown(item) for item in value[:60])}]")
    return visible(str(value))


def one_of(choices: Iterable[object], value: object) -> str:
    """Return the list of choices as in a file, with the one close to a value."""
    known = list(choices)
    near = difflib.get_close_matches(str(value)[:60], [str(choice) for choice in known], n=1)
    return f"{', '.join(map(shown, known))}{f'; did you mean {shown(near[0])}?' if near else ''}"


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise refusal(f"is {shown(value)}, not a text; allowed: text in quotation marks")
    if len(value) > 2000:
        raise refusal(f"has {len(value)} characters; allowed: at most 2000")
    if any(unicodedata.category(mark) in {"Cc", "Cs"} and mark not in "\n\t" for mark in value):
        raise refusal("has a control character; allowed: text, line feeds and tabs")
    return value


Text = Annotated[str, BeforeValidator(_text)]
M = TypeVar("M", bound=Table)
