"""What the page asks: one question, `evaluate`, returns rows and charts; others begin runs, save files."""

from __future__ import annotations

import json
import secrets
import shlex
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from avc_casadi._errors import AvcError, Fault, InputError, fault_document
from avc_casadi._util.json_values import json_text
from avc_casadi._util.parallel import begin_process, without_interrupts
from avc_casadi._util.progress import Progress
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.design.registry import METHODS
from avc_casadi.files.catalogue import catalogue_names, device_names
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.files.device_file import load_device, parse_device
from avc_casadi.files.problem_file import dump_problem, problem_document
from avc_casadi.model.problem import Problem
from avc_casadi.present.explore.ends import LAW, pair_answer, pair_coupling, wall_answer, wall_coupling
from avc_casadi.present.explore.settings import (
    Form,
    RequestError,
    Settings,
    dropped_ranges,
    gain_fields,
    problem_fields,
    problem_of_settings,
    require_motion,
    settings_of,
)
from avc_casadi.present.row import Mark, Row, row, text_of
from avc_casadi.present.rows.recommend import recommendation
from avc_casadi.present.rows.subject import headline
from avc_casadi.recommendation.recommend import recommend

T = TypeVar("T")


class _Piped(Progress):
    """Progress through a pipe, a few times a second."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._last_s = connection, 0.0

    @contextmanager
    def step(self, what: str) -> Iterator[None]:
        self._connection.send(("state", f": {what}"))
        yield

    def advance(self, done: int, total: int, what: str = "") -> None:
        now = time.monotonic()
        if now - self._last_s >= 0.1:
            self._last_s = now
            self._connection.send(("state", f": {what}, {done} of {total or '?'}"))


def _work(work: Callable[[Any, Progress], Any], task: Any, connection: Connection) -> None:
    begin_process()
    try:
        connection.send(("result", work(task, _Piped(connection))))
    except AvcError as error:
        connection.send(("error", str(error)))


def _found(task: tuple[Problem, str], progress: Progress) -> tuple[Coupling | None, list[Row]]:
    """Return the coupling of a slow method, and its rows."""
    problem, method = task
    if method == "recommend":
        found = recommend(problem, progress=progress)
        return found.coupling, [one for one in recommendation(found).rows if one.rank == 0]
    gains = solve(problem, method, progress=progress)
    usable = bool(gains.usable.any())
    notes = [row("Note", note) for note in (gains.notes if usable else dict.fromkeys(gains.reason))]
    return Coupling.of(problem, gains) if usable else None, notes


class SlowRun:
    """A slow method in a process of its own, with progress and cancellation."""

    def __init__(self, problem: Problem, method: str) -> None:
        self.began_s = self.wanted_s = time.monotonic()
        self.state = self.error = ""
        self.result: tuple[Coupling | None, list[Row]] | None = None
        context = get_context("spawn")  # CasADi's threads do not survive a fork
        here, there = context.Pipe(duplex=False)
        with without_interrupts():
            self._process = context.Process(target=_work, args=(_found, (problem, method), there), daemon=True)
            self._process.start()
        there.close()
        threading.Thread(target=self._listen, args=(here,), daemon=True).start()

    @property
    def over(self) -> bool:
        """Whether it has ended, for any reason."""
        return self.result is not None or bool(self.error)

    def cancel(self) -> None:
        """Terminate it, without a result."""
        if not self.over:
            self.error = "cancelled"
            self._process.terminate()

    def _listen(self, connection: Connection) -> None:
        kind, content = "state", ""
        try:
            while kind == "state":
                self.state = content
                kind, content = connection.recv()
        except (EOFError, OSError):
            kind, content = "error", "it ended without a result; there may be too little memory"
        if not self.error:
            self.result, self.error = (content, "") if kind == "result" else (None, content)  # type: ignore[assignment]
        self._process.join()


class Explorer:
    """A problem to explore, and results by settings."""

    def __init__(self, base: Problem, source: str, versions: Mapping[str, str] | None = None) -> None:
        self.base, self.source, self.versions = base, source, versions or {}
        pair = base.simulation is not None or base.follower is not None
        live, slow = ([name for name, one in METHODS.items() if one.pointwise is at_once] for at_once in (True, False))
        kinds = ((), ("recommend",)) if pair else (tuple(live), ("recommend", *slow))
        self.form = Form(problem_fields(base), gain_fields(base), *kinds)
        self._cache: OrderedDict[str, tuple[threading.Lock, list[Any]]] = OrderedDict()
        self._lock = threading.Lock()
        self._runs: dict[str, SlowRun] = {}

    def settings(self, question: Mapping[str, Any]) -> Settings:
        """Return the settings of a question."""
        return settings_of(question.get("settings"), self.form)

    def problem(self, settings: Settings) -> Problem:
        """Return the problem of the settings."""
        key = f"problem {settings.method in self.form.live} {settings.key('motion')}"
        return self.cached(key, lambda: problem_of_settings(self.base, settings, self.form))

    def cached(self, key: str, make: Callable[[], T]) -> T:
        """Return a result by its key; two threads that want it compute it once."""
        with self._lock:
            lock, found = self._cache.setdefault(key, (threading.Lock(), []))
            self._cache.move_to_end(key)
            while len(self._cache) > 64:
                self._cache.popitem(last=False)
        with lock:
            if not found:
                found.append(make())
            result: T = found[0]
            return result

    def run(self, settings: Settings, *, begin: bool = False, cancel: bool = False) -> SlowRun | None:
        """Return the run of the settings; begin it or cancel it. None where there is none."""
        key, now = settings.key("method"), time.monotonic()
        problem = self.problem(settings) if begin else self.base
        with self._lock:
            for one in self._runs.values():
                if now - one.wanted_s > 15:  # a page that was closed no longer asks
                    one.cancel()
            found = self._runs.get(key)
            if found is not None:
                found.wanted_s = now
                if cancel:
                    found.cancel()
            if begin and (found is None or found.error):
                if sum(not one.over for one in self._runs.values()) >= 2:
                    raise RequestError(409, "2 runs are under way; cancel one of them first")
                found = self._runs[key] = SlowRun(problem, settings.method)
            return found

    def coupling(self, settings: Settings) -> Coupling | None:
        """Return what the run of the settings has found; None where there is nothing yet."""
        run = self.run(settings)
        return None if run is None or run.result is None else run.result[0]

    def run_rows(self, settings: Settings) -> list[Row]:
        """Return the rows of the run of the settings: how far it is, or what it has found."""
        run = self.run(settings)
        label = "Recommendation" if settings.method == "recommend" else settings.method.capitalize()
        if run is None:
            return [row(label, "not computed for these settings yet: Run begins it")]
        if not run.over:
            return [row(label, f"running for {time.monotonic() - run.began_s:.0f} s{run.state}")]
        return [row(label, f"ended: {run.error}", mark=Mark.FAIL)] if run.result is None else run.result[1]

    def close(self) -> None:
        """End all runs."""
        for one in self._runs.values():
            one.cancel()


def start(explorer: Explorer, _: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page is built from: fields, devices, methods."""
    base, form = explorer.base, explorer.form
    devices = [one for one in map(load_device, device_names()) if one.device.motion == base.device.motion]
    # A file of one's own is opened to deploy; the catalogue shows the paper's question.
    own = explorer.source not in catalogue_names()
    return {
        "fields": [field.document() for field in form.fields],
        "gains": [field.document() for field in form.gains],
        "devices": [{"name": one.name, "title": one.title} for one in devices],
        "live": form.live,
        "slow": form.slow,
        "method": "recommend" if own or not form.live else "direct",
    }


def evaluate(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return rows and charts of one's own gains and of the method; with ``whole`` what takes a second or more too."""
    settings, form = explorer.settings(question), explorer.form
    problem = explorer.problem(settings)
    run = explorer.run(settings)
    answer = wall_answer if form.live else pair_answer
    gains, own, method, charts = answer(explorer, settings, problem, whole=bool(question.get("whole")))
    if settings.method in form.slow:
        method = [*explorer.run_rows(settings), *method]
    tables = problem_document(problem)
    return {
        "title": problem.title or problem.name,
        "headline": text_of(headline(problem, ""), problem.units).strip(),
        "values": {field.key: field.value(tables) for field in form.fields},
        "dropped": dropped_ranges(explorer.base, settings, problem),
        "gains": gains,
        "rows": {"own": _rows(own, problem), "method": _rows(method, problem)},
        "running": run is not None and not run.over,
        "done": run is not None and run.result is not None,
        "charts": charts,
    }


def _rows(rows: Sequence[Row], problem: Problem) -> list[dict[str, str]]:
    return [{"label": one.label, "text": one.text(problem.units), "mark": one.mark.name.lower()} for one in rows]


def run(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Begin or cancel the run of a slow method, and return its rows."""
    settings = explorer.settings(question)
    if settings.method not in explorer.form.slow:
        raise RequestError(400, f"{settings.method} follows at once and is no run")
    found = explorer.run(settings, begin=bool(question.get("begin")), cancel=bool(question.get("cancel")))
    rows = _rows(explorer.run_rows(settings), explorer.base)
    done = found is not None and found.result is not None
    return {"rows": rows, "running": found is not None and not found.over, "done": done}


def device(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a device file that was read in the browser, or of a device of the catalogue."""
    text, name = question.get("text"), question.get("name")
    if isinstance(text, str):
        found = parse_device(text, file=str(question.get("file", "device.toml"))[:200])
    elif isinstance(name, str):
        found = load_device(name)
    else:
        raise RequestError(400, "device needs text or name")
    require_motion(found.device, explorer.base.device)
    gaps = ", ".join(map(found.device.units.key, found.gaps))
    note = f"Not known of it, and taken cautiously: {gaps}." if gaps else ""
    return {"note": note, "device": found.device.model_dump(mode="json", exclude_unset=True)}


def file(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem or the coupling as a file, or both as commands to type."""
    settings, kind = explorer.settings(question), question.get("kind")
    problem = explorer.problem(settings)
    whole = problem_of_settings(explorer.base, settings, explorer.form, to_save=True)
    stem = f"{problem.name.replace('/', '-') or 'problem'}{'-b' if question.get('column') == 'b' else ''}"
    stem = f"./{stem}" if stem.startswith("-") else stem  # no option
    if kind == "problem":
        return {"name": f"{stem}.toml", "text": dump_problem(whole)}
    if kind == "command":
        return {"name": "", "text": _command(explorer, settings, whole, stem)}
    if kind != "coupling":
        raise RequestError(400, "kind is problem, coupling or command")
    of = wall_coupling if explorer.form.live else pair_coupling
    coupling, verdict = of(explorer, settings, problem)
    text = json_text(coupling_document(coupling), problem.units)
    return {"name": f"{stem}-coupling.json", "text": text, "note": verdict}


def _command(explorer: Explorer, settings: Settings, problem: Problem, stem: str) -> str:
    """Return what to type for the same: the problem as a file where it is none yet, then the verbs."""
    lines, which, out = [], shlex.quote(explorer.source), shlex.quote(f"{stem}-coupling.json")
    if settings.values or settings.device is not None:
        which = shlex.quote(f"{stem}.toml")
        lines = [f"cat > {which} <<'AVC_PROBLEM'", dump_problem(problem).rstrip(), "AVC_PROBLEM"]
    method = "" if settings.method == "recommend" else f" --method {settings.method}"
    lines.append(f"avc {'solve' if method else 'recommend'} {which}{method} --out {out}")
    if explorer.form.live:
        law = {name: settings.gains[key] for name, key in LAW.items() if settings.gains.get(key) is not None}
        typed = " ".join(f"--{name.replace('_', '-')} {value!r}" for name, value in law.items())
        lines += [f"avc certify {which} {typed}"] if typed else []
    return "\n".join(lines) + "\n"


PARTS = {each.__name__: each for each in (start, evaluate, run, device, file)}
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
MOST_BYTES = 2**18
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

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse what http.server itself does not understand; a method that is not there is the client's fault."""
        self.close_connection = True
        self._send(405 if code == 501 else code, "application/json", _error(message or explain or "refused"))

    def log_message(self, *_: object) -> None:
        """Say nothing: the token would stand in every line."""

    def _reply(self, make: Any) -> None:
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
        """Return the path behind the token of a request of this page."""
        own = {f"{HOST}:{self.server.port}", f"localhost:{self.server.port}"}
        if self.headers.get_all("Host", []) not in [[name] for name in own]:
            raise RequestError(421, "this server answers to its own address only")
        origin = self.headers.get("Origin")
        if origin is not None and origin.removeprefix("http://") not in own:
            raise RequestError(403, "requests of other pages are refused")
        if self.headers.get("Sec-Fetch-Site", "none") not in {"none", "same-origin"}:
            raise RequestError(403, "requests of other pages are refused")
        token, _, path = self.path.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            raise RequestError(403, "the address lacks the token; take the one that avc explore has printed")
        return path

    def _file(self, path: str) -> tuple[str, bytes]:
        name = path.partition("?")[0] or "index.html"
        if name not in self.server.page:
            raise RequestError(405 if name in PARTS else 404, "there is no such page")
        kind = _TYPES[name[name.rindex(".") :]]
        return f"{kind}; charset=utf-8", self.server.page[name]

    def _part(self, path: str) -> tuple[str, bytes]:
        if path not in PARTS:
            raise RequestError(405 if path in (*self.server.page, "") else 404, "there is nothing to ask there")
        if self.headers.get_content_type() != "application/json":
            raise RequestError(415, "a question is JSON: Content-Type application/json")
        document = json.dumps(answer(self.server.explorer, path, self._question()), allow_nan=False)
        return "application/json", document.encode()

    def _question(self) -> dict[str, Any]:
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit()):
            raise RequestError(411, "a question needs its Content-Length")
        if len(length) > len(str(MOST_BYTES)) or int(length) > MOST_BYTES:
            raise RequestError(413, f"a question has at most {MOST_BYTES} bytes")
        try:
            found = json.loads(self.rfile.read(int(length)), parse_constant=_refuse)
        except (ValueError, RecursionError) as error:
            raise RequestError(400, "the question is no JSON") from error
        if not isinstance(found, dict):
            raise RequestError(400, "a question is an object of JSON")
        return found

    def _send(self, status: int, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": kind, "Content-Length": str(len(content)), **_HEADERS}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)


def _error(message: str) -> bytes:
    return json_text({"error": message}).encode()


def _refuse(name: str) -> None:
    raise ValueError(name)
