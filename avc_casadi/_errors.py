"""The exception family: each error says what, where, the value, what is allowed and the next step."""

from __future__ import annotations

from dataclasses import asdict, dataclass

# Largest size of a fault report, for any number and length of faults.
_MOST_FAULTS = 20
_MOST_CHARACTERS = 1800


class AvcError(Exception):
    """Base of every error raised on purpose; the command line prints it without a traceback.

    Example:
        >>> try:
        ...     avc.solve("figure5", "exakt")
        ... except avc.AvcError as error:
        ...     print(str(error).partition(";")[0])
        method: 'exakt' is not a known method, did you mean exact?
    """

    def __str__(self) -> str:
        return _cut(super().__str__(), _MOST_CHARACTERS)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."


@dataclass(frozen=True)
class Fault:
    """One fault of an input file; ``str`` joins its place and message as ``file:line: key: message``.

    Attributes:
        file: the file as the user named it; empty where a call or a command is at fault.
        line: 1-based line of the key, or None where the fault belongs to no line.
        key: dotted key, for example ``device.mass_kg``; empty for the whole file.
        message: what is wrong (with the value) and what is allowed.

    Example:
        >>> try:
        ...     avc.parse_problem("[device]")
        ... except avc.InputError as error:
        ...     print(error.faults[0].key, error.faults[0].line)
        device.mass_kg 1
    """

    file: str
    line: int | None
    key: str
    message: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return ": ".join(part for part in (place, self.key, self.message) if part)


class InputError(AvcError, ValueError):
    """A file or an argument is wrong; carries all faults at once (command line: exit code 2).

    Example:
        >>> try:
        ...     avc.load_problem("figur5")
        ... except avc.InputError as error:
        ...     print(len(error.faults))
        1
    """

    def __init__(self, faults: list[Fault] | tuple[Fault, ...]) -> None:
        self.faults = tuple(faults)
        super().__init__(self.faults)  # what a worker's error is made of again

    def __str__(self) -> str:
        return "\n".join(map(str, self.told))

    @property
    def told(self) -> tuple[Fault, ...]:
        """The first faults, in 20 lines and 1800 characters, and one with the number of the others."""
        told, characters_left = list[Fault](), _MOST_CHARACTERS
        for fault in self.faults[:_MOST_FAULTS]:
            shortened = Fault(_cut(fault.file, 500), fault.line, _cut(fault.key, 200), _cut(fault.message, 1000))
            characters_left -= len(str(shortened)) + 1
            if characters_left < 0:
                break
            told.append(shortened)
        more = len(self.faults) - len(told)
        return (*told, Fault(told[-1].file, None, "", f"has {more} more faults")) if more else tuple(told)

    @classmethod
    def of(cls, message: str, *, file: str = "", key: str = "") -> InputError:
        """Return the error of a single fault."""
        return cls([Fault(file=file, line=None, key=key, message=message)])


def fault_document(error: InputError) -> dict[str, list[dict[str, str | int | None]]]:
    """Return the JSON document of bad input, ``{"errors": [{file, line, key, message}]}``: the faults as reported.

    Example:
        >>> avc.fault_document(avc.InputError.of("is wrong", file="p.toml", key="device"))
        {'errors': [{'file': 'p.toml', 'line': None, 'key': 'device', 'message': 'is wrong'}]}
    """
    return {"errors": [asdict(fault) for fault in error.told]}


class UnsupportedError(AvcError, NotImplementedError):
    """The request is valid but this method, model or combination does not offer it; names one that does.

    Example:
        >>> try:
        ...     avc.solve("hard/undamped-device", "static")
        ... except avc.UnsupportedError as error:
        ...     print(error.key)
        device.damping_ns_per_m
    """

    def __init__(self, message: str = "", *, key: str = "") -> None:
        super().__init__(message)
        self.key = key


class MissingExtraError(AvcError, ImportError):
    """An optional dependency is not installed; says the command that installs it.

    Raised by what needs it: the emulated board (``emulator``), an import of a model (``model``), 50 digits
    (``accuracy``).
    """


class LinkError(AvcError, OSError):
    """The device link failed: no answer, refused, unplugged (command line: exit code 1).

    Raised by `avc_hardware`, which talks to devices; the message begins with the port and says what to look at.
    """


class PortError(LinkError):
    """The named port does not exist or cannot be opened (command line: exit code 2); says what is allowed."""


class NotDeployableError(AvcError):
    """A coupling that must not be deployed: the claim that fails and the next step (command line: exit code 1).

    Raised by push, stream and export of `avc_hardware`, where ``unsafe=True`` overrides it. `deployable` gives the same
    verdict without raising.
    """


class WorkerLostError(AvcError, RuntimeError):
    """A worker process died, and its task with it (exit code 2): memory ran out, or it was killed."""
