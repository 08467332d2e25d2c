"""avc-casadi: design, certify, simulate and deploy adaptive virtual couplings for haptic devices.

In the order of a day with a device (``import avc_casadi as avc``):

    avc.load_problem("figure5")                    # device, wall and hands: a file, or a name of `avc.catalogue()`
    avc.zwidth("figure5")                          # which walls the device can render without a coupling
    avc.certify_law("figure5", k=3000.0, b=4.0)    # your own spring and damper: do they hold, and by how much
    found = avc.recommend("figure5")               # the coupling to deploy, and why; found.coupling
    avc.deployable(found.coupling)                 # the verdict on any coupling; avc.certify says which claims it meets
    avc.simulate("figure5", found.coupling)        # position and force at the hand over time; avc.screen: which effects
    avc.write_coupling(found.coupling, "c.json")   # for `avc push` and `avc export`; avc.read_coupling reads it
    avc.solve("figure5", "direct")                 # gains against frequency by a method of the paper
    avc.compare("figure5", mine=(2000.0, 7.0))     # the methods and your own (k, b), frequency by frequency

Every call that takes a problem takes a `Problem`, a file or a name. ``print`` shows an answer in the rows of the
command, ``repr`` in a line; ``to_dict()`` returns its columns, and ``avc.figures`` draws it. Units are SI and stand in
the names (``_n_per_m``, ``_ns_per_m``, ``_hz``); of a device that turns read rad for m and N.m for N. Errors derive
from `AvcError` and say the fault, its place and the next step.
"""

from __future__ import annotations

from avc_casadi._util.page import print_by as _print_by

TYPE_CHECKING = False  # typing takes long to load, and Ctrl-C meanwhile is a traceback

__version__ = "0.4.0"

# In the order of a user's day: problems, what a device can render, a coupling, its verdict, its motion, its file; the
# methods of the paper; errors.
__all__ = ["Problem", "catalogue", "catalogue_path", "dump_problem", "load_device", "load_problem", "parse_problem"]
__all__ += ["AdmittanceCertificate", "AdmittanceProblem", "certify_admittance", "load_admittance"]
__all__ += ["AdmittanceRecommendation", "MassWidth", "mass_width", "recommend_admittance"]
__all__ += ["ForceFeedbackCertificate", "ForceFeedbackProblem", "certify_force_feedback", "recommend_force_feedback"]
__all__ += ["Coupling", "LawCertificate", "Recommendation", "certify_law", "recommend", "zwidth"]
__all__ += ["certify_joint", "recommend_joint"]
__all__ += ["Certificate", "Deployable", "Run", "certify", "deployable", "screen", "simulate", "simulate_batch"]
__all__ += ["Comparison", "GainSchedule", "compare", "figures", "read_coupling", "solve", "write_coupling"]
__all__ += ["AvcError", "Fault", "InputError", "NotDeployableError", "UnsupportedError", "fault_document"]
__all__ += ["LinkError", "MissingExtraError", "PortError", "WorkerLostError"]


def _present() -> object:
    from avc_casadi.present.rows import answers  # noqa: PLC0415 - the rows are loaded at the first print

    return answers


_print_by(_present)

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
    from avc_casadi.claims.admittance import AdmittanceCertificate, certify_admittance
    from avc_casadi.claims.certify import Certificate, certify
    from avc_casadi.claims.deployable import Deployable, deployable
    from avc_casadi.claims.force_feedback import ForceFeedbackCertificate, certify_force_feedback
    from avc_casadi.claims.joint import certify_joint
    from avc_casadi.claims.mass_width import MassWidth, mass_width
    from avc_casadi.claims.own_law import LawCertificate, certify_law
    from avc_casadi.claims.zwidth import zwidth
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.comparison.comparison import Comparison, compare
    from avc_casadi.design.methods import solve
    from avc_casadi.design.scene_coupling import screen, simulate
    from avc_casadi.files.admittance_file import load_admittance
    from avc_casadi.files.catalogue import catalogue, catalogue_path
    from avc_casadi.files.coupling_file import read_coupling, write_coupling
    from avc_casadi.files.device_file import load_device
    from avc_casadi.files.problem_file import dump_problem, load_problem, parse_problem
    from avc_casadi.model.admittance import AdmittanceProblem
    from avc_casadi.model.gains import GainSchedule
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.sensed import ForceFeedbackProblem
    from avc_casadi.present import figures
    from avc_casadi.recommendation.admittance import AdmittanceRecommendation, recommend_admittance
    from avc_casadi.recommendation.force_feedback import recommend_force_feedback
    from avc_casadi.recommendation.joint import recommend_joint
    from avc_casadi.recommendation.recommend import recommend
    from avc_casadi.recommendation.recommendation import Recommendation
    from avc_casadi.simulation.scene import Run, simulate_batch
else:
    # Imported at first use: pydantic, numpy and CasADi would make `avc --help` slow.
    _NAMES = {
        "_errors": "AvcError Fault InputError LinkError MissingExtraError "
        "NotDeployableError PortError UnsupportedError WorkerLostError fault_document",
        "claims.certify": "Certificate certify",
        "claims.admittance": "AdmittanceCertificate certify_admittance",
        "claims.force_feedback": "ForceFeedbackCertificate certify_force_feedback",
        "claims.mass_width": "MassWidth mass_width",
        "recommendation.admittance": "AdmittanceRecommendation recommend_admittance",
        "model.admittance": "AdmittanceProblem",
        "model.sensed": "ForceFeedbackProblem",
        "files.admittance_file": "load_admittance",
        "claims.zwidth": "zwidth",
        "claims.deployable": "Deployable deployable",
        "claims.joint": "certify_joint",
        "claims.own_law": "LawCertificate certify_law",
        "recommendation.recommendation": "Recommendation",
        "recommendation.force_feedback": "recommend_force_feedback",
        "recommendation.joint": "recommend_joint",
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
