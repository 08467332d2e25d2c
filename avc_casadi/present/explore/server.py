"""What the page asks: one question, `evaluate`, returns rows and charts; others begin runs, save files."""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from dataclasses import asdict
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any
from urllib.parse import urlsplit

from avc_casadi._errors import AvcError, Fault, InputError, fault_document
from avc_casadi._util.json_values import json_text
from avc_casadi.files.coupling_file import coupling_text
from avc_casadi.present.explore import admittance as _admittance  # noqa: F401 - registers its functions
from avc_casadi.present.explore.ends import Extent, file_of, headline_of, page_answer, saved_coupling
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.settings import (
    Explored,
    RequestError,
    Settings,
    document_of,
    dropped_ranges,
    problem_of_settings,
    settings_of,
)
from avc_casadi.present.explore.verdict import Judged
from avc_casadi.present.row import Mark, text_of


def start(explorer: Explorer, _: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page is built from: fields and methods."""
    form = explorer.form
    return {
        "fields": [field.document() for field in form.fields],
        "gains": [field.document() for field in form.gains],
        "live": form.live,
        "slow": form.slow,
        "method": OPENS_WITH["method"],
        "couples": explorer.base.end.couples,
    }


OPENS_WITH: dict[str, Any] = {"values": {}, "gains": {}, "method": "recommend", "motion": "press"}
"""Settings with which a page opens: the problem as it stands, next to what is recommended for it."""


def evaluate(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return charts of one's own gains and of the method, and as far as the question goes verdicts and rows."""
    settings, form = settings_of(question.get("settings"), explorer.form), explorer.form
    extent = _extent(question.get("extent", "rows"))
    problem = explorer.problem(settings)
    shown = page_answer(problem.end, explorer, settings, problem, extent)
    tables = document_of(problem.end, problem)
    found: dict[str, Any] = {
        "title": problem.title or problem.name,
        "headline": text_of(headline_of(problem.end, problem), problem.units).strip(),
        "values": {field.key: field.value(tables) for field in form.fields},
        "dropped": dropped_ranges(explorer.base, settings, problem),
        "gains": shown.gains,
        "charts": shown.charts,
    }
    if extent is Extent.PICTURES:
        return found
    own, method = shown.own, shown.method
    if settings.method in form.slow:
        method = explorer.judged(settings)
        found |= _progress(explorer, settings)
    return found | {
        "rows": {"own": _rows(own, problem), "method": _rows(method, problem)},
        "verdicts": {"own": _verdict(own, problem), "method": _verdict(method, problem)},
    }


def _extent(name: object) -> Extent:
    try:
        return Extent[str(name).upper()]
    except KeyError as error:
        allowed = ", ".join(extent.name.lower() for extent in Extent)
        raise RequestError(400, f"extent is one of {allowed}") from error


def _progress(explorer: Explorer, settings: Settings) -> dict[str, bool]:
    """Return whether the run of a slow method is under way, and whether it has found what it looks for."""
    slow_run = explorer.run(settings)
    return {
        "running": slow_run is not None and not slow_run.over,
        "done": slow_run is not None and slow_run.result is not None,
    }


def _rows(judged: Judged | None, problem: Explored) -> list[dict[str, str]]:
    """Return rows in the units of a problem."""
    units, rows = problem.units, () if judged is None else judged.rows
    return [{"label": row.name(units), "text": row.text(units), "mark": _mark(row.mark)} for row in rows]


def _verdict(judged: Judged | None, problem: Explored) -> dict[str, str] | None:
    """Return a verdict in the units of a problem; None where none is known yet."""
    if judged is None or judged.verdict is None:
        return None
    verdict = judged.verdict
    return {"mark": _mark(verdict.mark), "word": verdict.word, "margin": text_of(verdict.margin, problem.units)}


def _mark(mark: Mark) -> str:
    return mark.name.lower()


def warm(explorer: Explorer) -> None:
    """Answer the questions with which a page opens, in the order in which it asks them, before it does."""
    for extent in Extent:
        answer(explorer, "evaluate", {"settings": OPENS_WITH, "extent": extent.name.lower()})


def run(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Begin or cancel the run of a slow method, and return its rows."""
    settings = settings_of(question.get("settings"), explorer.form)
    if settings.method not in explorer.form.slow:
        raise RequestError(400, f"{settings.method} follows at once and is no run")
    explorer.run(settings, begin=bool(question.get("begin")), cancel=bool(question.get("cancel")))
    judged = explorer.judged(settings)
    return {
        "rows": _rows(judged, explorer.base),
        "verdict": _verdict(judged, explorer.base),
        **_progress(explorer, settings),
    }


def file(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem or the coupling as a file."""
    settings, kind = settings_of(question.get("settings"), explorer.form), question.get("kind")
    problem = explorer.problem(settings)
    whole = problem_of_settings(explorer.base, settings, explorer.form, to_save=True)
    stem = f"{problem.name.replace('/', '-') or 'problem'}{'-b' if question.get('column') == 'b' else ''}"
    if kind == "problem":
        return {"name": f"{stem}.toml", "text": file_of(whole.end, whole)}
    if kind != "coupling":
        raise RequestError(400, "kind is problem or coupling")
    coupling, verdict = saved_coupling(problem.end, explorer, settings, problem)
    return {"name": f"{stem}-coupling.json", "text": coupling_text(coupling), "note": verdict}


PARTS = {part.__name__: part for part in (start, evaluate, run, file)}
"""What the page can ask, by name."""


def answer(explorer: Explorer, part: str, question: Mapping[str, Any]) -> dict[str, Any]:
    """Answer a question; what is wrong with the settings is an answer too, each fault with its field."""
    try:
        return PARTS[part](explorer, question)
    except InputError as error:
        return {"errors": fault_document(error)["errors"]}
    except RequestError:
        raise
    except AvcError as error:
        return {"errors": [asdict(Fault("", None, "", str(error)))]}


HOST = "127.0.0.1"
"""The page is served to this machine alone."""

MOST_BYTES = 2**18
"""Longest question, bytes."""

_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
# Nothing but what this server sends; a page elsewhere can neither frame this one nor read it.
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class ExploreServer(ThreadingHTTPServer):
    """Serves the page of an explorer until it is shut down."""

    daemon_threads = True
    # A browser that opens many connections at once is not turned away.
    request_queue_size = 128

    def __init__(self, explorer: Explorer, port: int = 0) -> None:
        self.explorer = explorer
        self.token = secrets.token_urlsafe(18)
        folder = files("avc_casadi.present.explore").joinpath("page")
        kept = (item for item in folder.iterdir() if item.name[item.name.rfind(".") :] in _TYPES)
        self.page = {item.name: item.read_bytes() for item in kept}
        super().__init__((HOST, port), _Handler)

    @property
    def port(self) -> int:
        """The port that it listens at."""
        return int(self.server_address[1])

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{HOST}:{self.port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Pass over a browser that has gone."""


class _Handler(BaseHTTPRequestHandler):
    server: ExploreServer
    protocol_version = "HTTP/1.1"
    server_version = "avc"
    sys_version = ""
    timeout = 60
    # An answer's head and body are two writes: the second would wait up to 40 ms for the browser's acknowledgement.
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        self._reply(self._file)

    def do_POST(self) -> None:
        self._reply(self._part)

    def log_message(self, *_: object) -> None:
        """Say nothing: the token would stand in every line."""

    def _reply(self, make: Any) -> None:
        """Send what `make` returns for the path, or the error that it raises."""
        try:
            kind, content = make(self._path())
            self._send(200, kind, content)
        except RequestError as error:
            self.close_connection = True  # what was not read is not a request
            self._send(error.status, "application/json", _error(str(error)))
        except OSError:
            self.close_connection = True
        except Exception as error:  # noqa: BLE001 - one answer that fails leaves the page alive
            self._send(500, "application/json", _error(f"internal error: {error!r}; please report it"))

    def _path(self) -> str:
        """Return the path behind the token, which no page elsewhere knows, under whatever name it reaches this one."""
        token, _, path = self.path.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            raise RequestError(403, "the address lacks the token; take the one that avc explore has printed")
        return path

    def _file(self, path: str) -> tuple[str, bytes]:
        name = urlsplit(path).path or "index.html"
        if name not in self.server.page:
            raise RequestError(404, "this page does not exist")
        kind = _TYPES[name[name.rindex(".") :]]
        return f"{kind}; charset=utf-8", self.server.page[name]

    def _part(self, path: str) -> tuple[str, bytes]:
        if path not in PARTS:
            raise RequestError(404, "this address accepts no requests")
        document = json.dumps(answer(self.server.explorer, path, self._question()), allow_nan=False)
        return "application/json", document.encode()

    def _question(self) -> dict[str, Any]:
        """Return the JSON object of a request; RequestError for anything else."""
        try:
            length = int(self.headers.get("Content-Length", ""))
            question = json.loads(self.rfile.read(length)) if 0 < length <= MOST_BYTES else None
        except (ValueError, RecursionError) as error:
            raise RequestError(400, "the question is not valid JSON") from error
        if not isinstance(question, dict):
            raise RequestError(400, f"a question is an object of JSON of at most {MOST_BYTES} bytes")
        return question

    def _send(self, status: int, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": kind, "Content-Length": str(len(content)), **_HEADERS}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)


def _error(message: str) -> bytes:
    return json_text({"error": message}).encode()
