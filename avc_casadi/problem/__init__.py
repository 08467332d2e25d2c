"""The problem file and its strict validation."""

from avc_casadi.problem._model import Boundaries as Boundaries
from avc_casadi.problem._model import Coupling as Coupling
from avc_casadi.problem._model import Device as Device
from avc_casadi.problem._model import Frequency as Frequency
from avc_casadi.problem._model import Hands as Hands
from avc_casadi.problem._model import Impedance as Impedance
from avc_casadi.problem._model import Problem as Problem
from avc_casadi.problem._model import Realism as Realism
from avc_casadi.problem._model import Scene as Scene
from avc_casadi.problem._model import ScheduleSettings as ScheduleSettings
from avc_casadi.problem._model import Stability as Stability
from avc_casadi.problem._model import Structure as Structure
