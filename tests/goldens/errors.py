"""Bad input of many kinds: the faults of each, with file, line and key."""

from __future__ import annotations

import io
import json
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any

from avc_casadi.cli import main

_GOOD = """\
[device]
mass_kg = 0.1
damping_ns_per_m = 2.0
[environment]
damping_ns_per_m = 1.0
stiffness_n_per_m = 3000.0
"""
_CSV = "frequency_hz,damping_ns_per_m,stiffness_n_per_m\n"


def _with(extra: str) -> dict[str, str]:
    return {"bad.toml": _GOOD + extra}


def _but(old: str, new: str) -> dict[str, str]:
    return {"bad.toml": _GOOD.replace(old, new)}


# What it is about: what is typed, and the files that stand in the folder.
ERRORS: dict[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "unknown verb": (("paint",), {}),
    "no verb": ((), {}),
    "unknown name": (("solve", "figgure5"), {}),
    "file is not there": (("check", "nowhere.toml"), {}),
    "no toml": (("check", "bad.toml"), {"bad.toml": "[device\nmass_kg = 0.1\n"}),
    "negative mass": (("check", "bad.toml"), _but("mass_kg = 0.1", "mass_kg = -0.1")),
    "text for a number": (("check", "bad.toml"), _but("mass_kg = 0.1", 'mass_kg = "0.1"')),
    "infinite stiffness": (("check", "bad.toml"), _but("3000.0", "inf")),
    "unknown table": (("check", "bad.toml"), _with("[colour]\nred = 1\n")),
    "unknown key": (("check", "bad.toml"), _with("[coupling]\ncolour = 'red'\n")),
    "unknown structure": (("check", "bad.toml"), _with("[coupling]\nstructure = 'parallel'\n")),
    "interval upside down": (("check", "bad.toml"), _with("[coupling]\ndamping_ns_per_m = [10.0, 1.0]\n")),
    "beyond nyquist": (("check", "bad.toml"), _with("[frequency]\nstart_hz = 1.0\nstop_hz = 600.0\n")),
    "range without its value": (("check", "bad.toml"), _with("[device.range]\nmass_kg = [0.2, 0.3]\n")),
    "unknown device": (("check", "bad.toml"), {"bad.toml": 'device = "omni"\n[environment]\ndamping_ns_per_m = 0.0\n'}),
    "rotary key on a linear device": (("check", "bad.toml"), _but("mass_kg = 0.1", "inertia_kgm2 = 0.1")),
    "effect that is none": (("check", "bad.toml"), _with("[[scene.effects]]\nkind = 'wind'\n")),
    "five faults": (
        ("solve", "bad.toml"),
        _but("mass_kg = 0.1", "mass_kg = -0.1\nred = 1")
        | {
            "bad.toml": '[device]\nmass_kg = -0.1\ndamping_ns_per_m = "2"\n[environment]\ndamping_ns_per_m = 10.0\n'
            'stiffness_n_per_m = inf\n[coupling]\nstructure = "parallel"\ncolour = "red"\n'
        },
    ),
    "unknown method": (("solve", "figure5", "--method", "magic"), {}),
    "method that does not offer it": (("solve", "hard/undamped-device", "--method", "static"), {}),
    "unknown solver": (("solve", "figure5", "--solver", "magic"), {}),
    "tolerance in words": (("solve", "figure5", "--tolerance", "tight"), {}),
    "unknown suffix": (("solve", "figure5", "--out", "gains.xls"), {}),
    "folder is not there": (("solve", "figure5", "--out", "nowhere/gains.json"), {}),
    "half a pair": (("compare", "figure5", "--mine", "7000"), {}),
    "negative pair": (("compare", "figure5", "--mine", "7000,-1"), {}),
    "no gains to certify": (("certify", "figure5"), {}),
    "gain file with a word": (("certify", "figure5", "g.csv"), {"g.csv": f"{_CSV}1.0,two,3000\n"}),
    "gain file with a hole": (("certify", "figure5", "g.csv"), {"g.csv": f"{_CSV}1.0,2.0,3000\n2.0,2.0\n"}),
    "gain file backwards": (("certify", "figure5", "g.csv"), {"g.csv": f"{_CSV}2.0,2.0,3000\n1.0,2.0,3000\n"}),
    "coupling file that is another": (("export", "c.json", "--c", "c"), {"c.json": '{"schema": "avc-list/2"}\n'}),
    "coupling file cut off": (("trial", "c.json"), {"c.json": '{"schema": "avc-coupling/1", "k": [1'}),
    "log without columns": (("identify", "log.csv"), {"log.csv": "a,b\n1,2\n2,3\n"}),
    "log of words": (("diagnose", "log.csv"), {"log.csv": "time_s,position_m,force_N\n0,zero,0\n"}),
    "port without a device": (("push", "c.json"), {"c.json": "{}"}),
    "no hands": (("recommend", "figure5", "--hands", "0"), {}),
}


def error(case: str) -> dict[str, Any]:
    """Return the exit code and the error document of bad input."""
    words, files = ERRORS[case]
    with tempfile.TemporaryDirectory() as name, chdir(name), redirect_stdout(io.StringIO()) as said:
        for file, text in files.items():
            Path(file).write_text(text, encoding="ascii")
        code = main([*words, "--json"])
    faults = [{key: fault[key] for key in ("file", "line", "key")} for fault in json.loads(said.getvalue())["errors"]]
    return {"exit_code": code, "errors": faults}
