"""A method, an effect and a claim are one file each, and no other file lists their names."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from avc_casadi.claims.registry import CLAIMS
from avc_casadi.design.registry import METHODS
from avc_casadi.model.registries import EFFECTS

ROOT = Path(__file__).parent.parent

METHOD = '''
"""A toy method: the same pair of gains at every frequency."""

from avc_casadi.design.registry import METHODS, Candidate, Method

METHODS.add(
    "toy",
    Method(
        f"{__name__}:solve_toy",
        "1 N.s/m and 100 N/m",
        live=True,
        candidates=(Candidate("toy", "1 N.s/m and 100 N/m", rank=35, constant=True),),
    ),
    rank=35,
)


def solve_toy(problem):
    import numpy as np

    from avc_casadi.model.schedule import Status
    from avc_casadi.paper.rendered import gain_schedule

    rows = len(problem.frequencies_hz())
    pair = (np.full(rows, 1.0), np.full(rows, 100.0), np.zeros(rows))
    return gain_schedule(problem, "toy", pair, (Status.SOLVED,) * rows)
'''


CLAIM = '''
"""A toy claim: no row is stiffer than 1 kN/m."""

from avc_casadi.claims.registry import Claim


class Soft(Claim):
    name = "T1"
    title = "softer than 1 kN/m"
    rank = 45
    claims = "each row is softer than 1 kN/m"
    leaves = "everything else"

    def judge(self, judged):
        import numpy as np

        from avc_casadi.claims.levels import level_result

        rows = judged.rows
        none = np.zeros(len(rows.k))
        return level_result(
            rows, self.name, "sampled-data", "softer than 1 kN/m", rows.k < 1e3, 1e3 - rows.k, none, none
        )
'''


EFFECT = '''
"""A toy effect: the sensor reads the position too large by an offset."""

from dataclasses import dataclass
from typing import Literal

from avc_casadi.model.effects import EffectTable
from avc_casadi.model.quantity import Length
from avc_casadi.simulation.effects.base import SceneEffect, Station


class OffsetKeys(EffectTable):
    """Offset of the sensor."""

    kind: Literal["offset"] = "offset"
    offset_m: Length


@dataclass(frozen=True)
class Offset(SceneEffect):
    kind = "offset"
    keys = OffsetKeys
    rank = 75
    station = Station.SENSING

    offset_m: float

    @classmethod
    def build(cls, table, problem, place):
        return cls(table.offset_m)

    def sample(self, tick):
        tick.position += self.offset_m
'''

SCENE = """
[device]
mass_kg = 0.1
damping_ns_per_m = 5.0
sample_time_s = 0.001
[environment]
damping_ns_per_m = 0.0
stiffness_n_per_m = 500.0
[hands]
mass_kg = [0.1, 0.1]
damping_ns_per_m = [5.0, 5.0]
stiffness_n_per_m = [300.0, 300.0]
[scene]
coupling = "none"
[[scene.effects]]
kind = "hand"
[[scene.effects]]
kind = "environment"
[[scene.effects]]
kind = "offset"
"""


def with_file(folder, package, text, code):
    """Run code in a process in which one more file stands in a folder that is scanned."""
    (folder / "toy.py").write_text(text, encoding="utf-8")
    program = f"import {package} as scanned\nscanned.__path__.append({str(folder)!r})\n{code}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)  # noqa: S603
    assert not done.stderr, done.stderr
    return done.stdout


COMMAND = "from avc_casadi.cli import main\nmain({})\n"


@pytest.mark.thorough
def test_a_method_is_one_file(tmp_path):
    package = "avc_casadi.design.method"
    told = with_file(tmp_path, package, METHOD, COMMAND.format(["solve", "soft", "--method", "toy", "--json"]))
    document = json.loads(told)
    assert document["method"] == "toy"
    assert set(document["stiffness_n_per_m"]) == {100.0}
    assert document["certificate"]["levels"]["L5"]["pass"] is not None
    lists = """
from avc_casadi.cli import main
from avc_casadi.model.scene import Scene
from avc_casadi.present.explore.forms import WALL
from avc_casadi.design.comparison.table1 import COUPLINGS, design
from avc_casadi.files.problem_file import load_problem
assert "toy" in WALL.live and list(COUPLINGS)[2:5] == ["static-sampled", "direct", "toy"], list(COUPLINGS)
assert Scene(coupling="toy").coupling == "toy"
assert design(load_problem("soft"), "toy").gains.stiffness_n_per_m == 100.0
try:
    main(["solve", "--help"])
except SystemExit:
    pass
"""
    assert "exact, toy, schedule" in " ".join(with_file(tmp_path, package, METHOD, lists).split())


@pytest.mark.thorough
def test_a_claim_is_one_file(tmp_path):
    package = "avc_casadi.claims.level"
    told = with_file(tmp_path, package, CLAIM, COMMAND.format(["solve", "soft", "--method", "exact", "--json"]))
    levels = json.loads(told)["certificate"]["levels"]
    assert set(levels) == {"T1", *(name for name, claim in CLAIMS.items() if not claim.on_demand)}
    k = np.array(json.loads(told)["stiffness_n_per_m"], dtype=float)
    assert levels["T1"]["title"] == "softer than 1 kN/m"
    assert levels["T1"]["row_pass"] == [bool(one < 1e3) for one in k]


@pytest.mark.thorough
def test_an_effect_is_one_file(tmp_path):
    """The spring of the wall and that of the hand hold the device where the offset moved their balance to."""
    package = "avc_casadi.simulation.effects"
    (tmp_path / "moved.toml").write_text(f"{SCENE}offset_m = 0.002\n", encoding="utf-8")
    (tmp_path / "wrong.toml").write_text(f"{SCENE}offset_mm = 2\n", encoding="utf-8")
    program = f"""
import json
import avc_casadi as avc
from avc_casadi.files.problem_document import dump_problem
problem = avc.load_problem({str(tmp_path / "moved.toml")!r})
assert avc.parse_problem(dump_problem(problem)).scene == problem.scene
run = avc.simulate(problem)
text = ""
try:
    avc.load_problem({str(tmp_path / "wrong.toml")!r})
except avc.InputError as error:
    text = str(error)
print(json.dumps([run.effects, run.position_m[-1], problem.scene.motion.end_m, text]))
"""
    effects, rests_m, target_m, text = json.loads(with_file(tmp_path, package, EFFECT, program))
    assert effects == ["hand", "offset", "environment"]
    assert rests_m == pytest.approx((300 * target_m - 500 * 0.002) / 800, rel=1e-6)
    assert "write offset_m = 0.002" in text
    explained = ["simulate", str(tmp_path / "moved.toml"), "--explain"]
    assert "offset" in with_file(tmp_path, package, EFFECT, COMMAND.format(explained))
    absent = ["simulate", "scenes/stiff-wall-pressed", "--explain"]
    assert "offset" in with_file(tmp_path, package, EFFECT, COMMAND.format(absent))


# Files and folders whose lists are not of what there is, but of what one program or another vocabulary holds.
OWN_CHOICE = {
    "methods": {
        "avc_casadi/design/comparison/table1.py": "the columns of the paper's table",
        "avc_casadi/present/figures/accuracy.py": "methods whose time is drawn beside those of solvers",
    },
    "claims": {},
    "effects": {
        "avc_casadi/simulation/population/trial.py": "kinds for which the conditions of a trial have a number",
        "avc_casadi/files/coupling_file.py": "fields of `Runtime`, two of which are called as effects are",
        "avc_casadi/identification/": "terms of a fit and causes of a buzz, some of which are called as effects are",
        "hardware/avc_hardware/in_the_loop.py": "what the bench and the firmware have, whatever scenes have",
    },
}


def listed(names):
    """Every place that holds two or more of the names as literals of one list, tuple, set, dict or Literal."""
    for folder in (ROOT / "avc_casadi", ROOT / "hardware" / "avc_hardware"):
        for path in sorted(folder.rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.List | ast.Tuple | ast.Set):
                    parts = node.elts
                elif isinstance(node, ast.Dict):
                    parts = [*node.keys, *node.values]
                else:
                    continue
                held = {part.value for part in parts if isinstance(part, ast.Constant)} & set(names)
                if len(held) > 1:
                    yield path.relative_to(ROOT).as_posix(), node.lineno, sorted(held)


@pytest.mark.thorough
@pytest.mark.parametrize(("sort", "names"), [("methods", METHODS), ("claims", CLAIMS), ("effects", EFFECTS)])
def test_no_other_file_lists_the_names(sort, names):
    found = list(listed(names))
    assert not [one for one in found if not one[0].startswith(tuple(OWN_CHOICE[sort]))]
    unused = [place for place in OWN_CHOICE[sort] if not any(one[0].startswith(place) for one in found)]
    assert not unused, "an exception that nothing needs any more"
