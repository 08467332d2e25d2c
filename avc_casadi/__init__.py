"""avc-casadi: design, certify, simulate and deploy adaptive virtual couplings for haptic devices."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi._errors import AvcError as AvcError
from avc_casadi._errors import Fault as Fault
from avc_casadi._errors import InputError as InputError
from avc_casadi._errors import LinkError as LinkError
from avc_casadi._errors import MissingExtraError as MissingExtraError
from avc_casadi._errors import NotDeployableError as NotDeployableError
from avc_casadi._errors import UnsupportedError as UnsupportedError
from avc_casadi._errors import fault_document as fault_document

__version__ = "0.1.0"

if TYPE_CHECKING:
    from avc_casadi.certificate import Certificate as Certificate
    from avc_casadi.certificate import Deployable as Deployable
    from avc_casadi.certificate import certify as certify
    from avc_casadi.certificate import deployable as deployable
    from avc_casadi.coupling import Coupling as Coupling
    from avc_casadi.coupling import GainSchedule as GainSchedule
    from avc_casadi.coupling import read_coupling as read_coupling
    from avc_casadi.coupling import write_coupling as write_coupling
    from avc_casadi.design import simulate as simulate
    from avc_casadi.design import solve as solve
    from avc_casadi.problem import Problem as Problem
    from avc_casadi.problem import catalogue as catalogue
    from avc_casadi.problem import catalogue_path as catalogue_path
    from avc_casadi.problem import dump_problem as dump_problem
    from avc_casadi.problem import load_problem as load_problem
    from avc_casadi.problem import parse_problem as parse_problem
    from avc_casadi.recommendation import Recommendation as Recommendation
    from avc_casadi.recommendation import recommend as recommend
    from avc_casadi.scene import Run as Run
    from avc_casadi.scene import simulate_batch as simulate_batch
    from avc_casadi.study.comparison import Comparison as Comparison
    from avc_casadi.study.comparison import compare as compare
else:
    # Imported at first use: pydantic, numpy and CasADi would make `avc --help` slow.
    _LAZY = {
        "Certificate": "certificate",
        "certify": "certificate",
        "Deployable": "certificate",
        "deployable": "certificate",
        "Coupling": "coupling",
        "GainSchedule": "coupling",
        "read_coupling": "coupling",
        "write_coupling": "coupling",
        "solve": "design",
        "Problem": "problem",
        "catalogue": "problem",
        "catalogue_path": "problem",
        "dump_problem": "problem",
        "load_problem": "problem",
        "parse_problem": "problem",
        "Run": "scene",
        "simulate": "design",
        "simulate_batch": "scene",
        "Recommendation": "recommendation",
        "recommend": "recommendation",
        "Comparison": "study.comparison",
        "compare": "study.comparison",
    }

    def __getattr__(name):
        if name not in _LAZY:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module  # noqa: PLC0415 - paid at first use only

        value = getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*globals(), *_LAZY})
