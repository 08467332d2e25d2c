"""For which hands and margins a verdict on deployment is: what the user declared, as the loops were judged with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from avc_casadi._util.json_values import Document
from avc_casadi._util.page import Worded, worded
from avc_casadi._util.units import Units
from avc_casadi.coupling import Coupling
from avc_casadi.loops.margins import LEAST_DISK
from avc_casadi.model.admittance import AdmittanceProblem, Contact
from avc_casadi.model.ends import Wall
from avc_casadi.model.problem import Hands, Problem


@dataclass(frozen=True)
class JudgedFor(Worded, Document):
    """The hands and the margin that a verdict on deployment is for.

    Attributes:
        hands: their ranges, in the device's units; the released device is judged too.
        units: of the device.
        disk_margin: required of every loop; None where none is judged.
        gain_margin: required of a coupling to another end than a wall; None of others.
        contact: what a handle on a force sensor may touch; None of devices without one.
    """

    hands: Hands
    units: Units
    disk_margin: float | None = None
    gain_margin: float | None = None
    contact: Contact | None = None

    @classmethod
    def of_admittance(cls, problem: AdmittanceProblem) -> JudgedFor:
        """Return what the verdict on the law of an admittance device is for."""
        return cls(problem.hands, problem.units, LEAST_DISK, contact=problem.contact)

    @classmethod
    def of_law(cls, problem: Problem) -> JudgedFor:
        """Return what the verdict on the table [law] of a problem is for."""
        return cls(problem.hands, problem.units, LEAST_DISK)

    @classmethod
    def of_coupling(cls, coupling: Coupling) -> JudgedFor:
        """Return what the verdict on a coupling is for, by the declarations of its own problem."""
        problem = coupling.problem
        robustness = problem.robustness
        if not isinstance(coupling.end, Wall):
            return cls(problem.hands, problem.units, gain_margin=robustness.gain_margin)
        if problem.device.mass_kg == 0:  # released, a massless device has no loop, and no margin is judged
            return cls(problem.hands, problem.units)
        required = LEAST_DISK if robustness.disk_margin is None else robustness.disk_margin
        return cls(problem.hands, problem.units, required)

    @property
    def sentence(self) -> str:
        """It in words, in the units of the device."""
        return worded(self, self.units)

    def document(self) -> dict[str, Any]:
        """Return the JSON document: ranges as [lowest, highest], what is touched, and the margin that is required."""
        margins = {"disk_margin": self.disk_margin, "gain_margin": self.gain_margin}
        required = {key: margin for key, margin in margins.items() if margin is not None}
        touched = {} if self.contact is None else {"contact": self.contact.document()}
        return {"hands": self.hands.model_dump(mode="json", exclude={"let_go"})} | touched | required
