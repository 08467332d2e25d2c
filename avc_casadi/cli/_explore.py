"""Turn knobs on a local page: device, hands, and wall or engine as sliders beside what they make of a coupling.

The page is served to this machine alone (127.0.0.1, a random token in its address), needs no network and ends with
Ctrl-C. Its settings stand in its address; it saves problem and coupling as files, and shows the commands for the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import avc_casadi as avc
from avc_casadi._util.interrupt import take_interrupt
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._versions import package_versions

if TYPE_CHECKING:
    import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "problem", metavar="P", nargs="?", default="figure5", help="problem file or name of the catalogue; figure5"
    )
    parser.add_argument("--port", type=_port, default=0, metavar="N", help="port of 127.0.0.1; default any free one")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Serve until Ctrl-C."""
    import webbrowser

    from avc_casadi.present.explore.explorer import Explorer
    from avc_casadi.present.explore.server import ExploreServer

    problem = load_problem(args.problem)
    if problem.follower is not None:
        message = "has a [follower], and the page has a wall or a [simulation]; avc recommend, run and export know it"
        raise avc.InputError.of(message, file=args.problem)
    explorer = Explorer(problem, args.problem, package_versions())
    try:
        server = ExploreServer(explorer, args.port)
    except OSError as error:
        raise avc.InputError.of(f"{args.port} cannot be used: {error.strerror}; leave it out", key="--port") from error
    document = {"schema": "avc-explore/1", "problem": problem.name, "url": server.url}
    with server:
        try:
            console.say(": ".join(filter(None, (problem.name, problem.title))))
            console.say(f"open {server.url} in a browser on this machine; Ctrl-C ends it")
            if console.as_json:
                console.complain(server.url)
            if args.open:
                webbrowser.open(server.url)
            server.serve_forever()
        except KeyboardInterrupt:
            take_interrupt()
            explorer.close()
    return Answer(document, "")


def _port(text: str) -> int:
    import argparse

    if not (text.isascii() and text.isdigit() and int(text) < 65536):
        raise argparse.ArgumentTypeError(f"{text!r} is no port; allowed: 0 to 65535")
    return int(text)
