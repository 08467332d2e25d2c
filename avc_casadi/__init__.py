"""avc-casadi: design, certify, simulate and deploy adaptive virtual couplings for haptic devices.

A problem is a file (`load_problem`), a name of the catalogue (`catalogue`), or a `Problem`; every call takes any of
the three. Seven calls answer most questions:

    import avc_casadi as avc

    avc.recommend("figure5")                       # the coupling to deploy, and why
    gains = avc.solve("figure5", "direct")         # gains against frequency, by one of the methods
    avc.certify("figure5", gains)                  # which stability claims they meet, and where they fail
    avc.certify_law("figure5", k=3000.0, b=4.0)    # your own spring and damper: do they hold, and by how much
    avc.compare("figure5", mine=(2000.0, 7.0))     # the methods and your own (k, b), frequency by frequency
    avc.simulate("scenes/stiff-wall-pressed")      # position and force at the hand over time
    avc.zwidth("figure5")                          # which walls the device can render at all

``print`` shows each of these answers in the rows of the command; ``repr`` is a line. Those with columns
return them with ``to_dict()``; ``avc.figures`` draws them. Errors derive from `AvcError` and state the fault, its
place, and the next step.
"""

from __future__ import annotations

from avc_casadi._util.page import print_by as _print_by

TYPE_CHECKING = False  # typing takes long to load, and Ctrl-C meanwhile is a traceback

__version__ = "0.3.0"

__all__ = ["AvcError", "Certificate", "Comparison", "Coupling", "Deployable", "Fault", "GainSchedule"]
__all__ += ["InputError", "LawCertificate", "LinkError", "MissingExtraError", "NotDeployableError"]
__all__ += ["PortError", "Problem", "Recommendation", "Run", "UnsupportedError", "WorkerLostError"]
__all__ += ["catalogue", "catalogue_path", "certify", "certify_law", "compare", "deployable"]
__all__ += ["dump_problem", "fault_document", "figures", "load_device", "load_problem", "parse_problem"]
__all__ += ["read_coupling", "recommend", "screen", "simulate", "simulate_batch", "solve"]
__all__ += ["write_coupling", "zwidth"]


def _text_of(result: object) -> str:
    from avc_casadi.present.rows.answers import text_of  # noqa: PLC0415 - the rows are loaded at the first print

    return text_of(result)


_print_by(_text_of)

if TYPE_CHECKING:
    from avc_casadi._errors import (
        AvcError,
        Fault,
        InputError,
        LinkError,
        MissingExtraError,
        NotDeployableError,
        PortError,
        UnsupportedError,
        WorkerLostError,
        fault_document,
    )
    from avc_casadi.claims.certify import Certificate, certify
    from avc_casadi.claims.deployable import Deployable, deployable
    from avc_casadi.claims.own_law import LawCertificate, certify_law
    from avc_casadi.claims.zwidth import zwidth
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.comparison.comparison import Comparison, compare
    from avc_casadi.design.methods import solve
    from avc_casadi.design.scene_coupling import screen, simulate
    from avc_casadi.files.catalogue import catalogue, catalogue_path
    from avc_casadi.files.coupling_file import read_coupling, write_coupling
    from avc_casadi.files.device_file import load_device
    from avc_casadi.files.problem_file import dump_problem, load_problem, parse_problem
    from avc_casadi.model.gains import GainSchedule
    from avc_casadi.model.problem import Problem
    from avc_casadi.present import figures
    from avc_casadi.recommendation.recommend import recommend
    from avc_casadi.recommendation.recommendation import Recommendation
    from avc_casadi.simulation.scene import Run, simulate_batch
else:
    # Imported at first use: pydantic, numpy and CasADi would make `avc --help` slow.
    _NAMES = {
        "_errors": "AvcError Fault InputError LinkError MissingExtraError "
        "NotDeployableError PortError UnsupportedError WorkerLostError fault_document",
        "claims.certify": "Certificate certify",
        "claims.zwidth": "zwidth",
        "claims.deployable": "Deployable deployable",
        "claims.own_law": "LawCertificate certify_law",
        "recommendation.recommendation": "Recommendation",
        "recommendation.recommend": "recommend",
        "coupling": "Coupling",
        "model.gains": "GainSchedule",
        "files.coupling_file": "read_coupling write_coupling",
        "design.scene_coupling": "screen simulate",
        "design.methods": "solve",
        "model.problem": "Problem",
        "files.catalogue": "catalogue catalogue_path",
        "files.problem_file": "dump_problem load_problem parse_problem",
        "files.device_file": "load_device",
        "simulation.scene": "Run simulate_batch",
        "design.comparison.comparison": "Comparison compare",
    }
    _LAZY = {name: module for module, names in _NAMES.items() for name in names.split()}

    def __getattr__(name):
        from importlib import import_module  # noqa: PLC0415 - paid at first use only

        if name == "figures":  # a package, not a name in one
            return import_module(f"{__name__}.present.{name}")
        if name not in _LAZY:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
