"""The server of `avc explore` answers its own page alone; anything else is refused, and nothing is computed."""

import http.client
import json
import threading

import pytest

import avc_casadi as avc
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.server import ExploreServer

SETTINGS = {"values": {}, "gains": {}, "method": "direct", "motion": "press"}
QUESTION = json.dumps({"settings": SETTINGS}).encode()
JSON = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def server():
    with ExploreServer(Explorer(avc.load_problem("soft"), "soft")) as started:
        threading.Thread(target=started.serve_forever, daemon=True).start()
        yield started
        started.shutdown()


@pytest.fixture
def untouched(server, monkeypatch):
    """Fails if anything is computed."""
    asked = []
    monkeypatch.setattr(server.explorer, "problem", asked.append)
    yield
    assert asked == []


def ask(server, method, path, body=b"", headers=None):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=600)
    try:
        connection.putrequest(method, path)
        for name, value in ({"Content-Length": str(len(body))} | (headers or {})).items():
            connection.putheader(name, value)
        connection.endheaders(body)
        answer = connection.getresponse()
        return answer.status, answer.read(), dict(answer.getheaders())
    finally:
        connection.close()


def inside(server, path):
    return f"/{server.token}/{path}"


def test_the_page_and_a_question_are_answered(server):
    status, page, headers = ask(server, "GET", inside(server, ""))
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert b"app.js" in page
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    status, answer, _ = ask(server, "POST", inside(server, "evaluate"), QUESTION, JSON)
    assert (status, server.server_address[0]) == (200, "127.0.0.1")
    assert len(json.loads(answer)["charts"][0]["series"][0]["x"]) == 200


@pytest.mark.parametrize(
    ("status", "method", "path", "body", "headers"),
    [
        (403, "GET", "/", b"", {}),
        (403, "POST", "/wrong/evaluate", QUESTION, JSON),
        (404, "GET", "TOKEN/../_server.py", b"", {}),
        (404, "POST", "TOKEN/nothing", QUESTION, JSON),
        (404, "GET", "TOKEN/evaluate", b"", {}),
        (400, "POST", "TOKEN/evaluate", b"", JSON | {"Content-Length": "-1"}),
        (400, "POST", "TOKEN/evaluate", b"", JSON | {"Content-Length": "99999999"}),
        (400, "POST", "TOKEN/evaluate", b"", JSON | {"Content-Length": "9" * 5000}),
        (400, "POST", "TOKEN/evaluate", b"{", JSON),
        (400, "POST", "TOKEN/evaluate", b'{"settings": NaN}', JSON),
        (400, "POST", "TOKEN/evaluate", b"[" * 100_000, JSON),
        (400, "POST", "TOKEN/evaluate", b'{"settings": {"values": {"device.__class__": 1}}}', JSON),
        (400, "POST", "TOKEN/run", b'{"settings": {"method": "rm"}}', JSON),
    ],
)
@pytest.mark.usefixtures("untouched")
def test_anything_else_is_refused(server, status, method, path, body, headers):
    found, answer, _ = ask(server, method, path.replace("TOKEN", f"/{server.token}"), body, headers)
    assert found == status
    assert json.loads(answer)["error"]
