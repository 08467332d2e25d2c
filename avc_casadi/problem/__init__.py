"""The problem file and its strict validation."""

from avc_casadi.problem._catalogue import CatalogueEntry as CatalogueEntry
from avc_casadi.problem._catalogue import catalogue as catalogue
from avc_casadi.problem._catalogue import catalogue_path as catalogue_path
from avc_casadi.problem._dump import dump_problem as dump_problem
from avc_casadi.problem._load import load_problem as load_problem
from avc_casadi.problem._load import parse_problem as parse_problem
from avc_casadi.problem._model import Boundaries as Boundaries
from avc_casadi.problem._model import Coupling as Coupling
from avc_casadi.problem._model import Device as Device
from avc_casadi.problem._model import DeviceRange as DeviceRange
from avc_casadi.problem._model import Frequency as Frequency
from avc_casadi.problem._model import Hands as Hands
from avc_casadi.problem._model import Impedance as Impedance
from avc_casadi.problem._model import Objective as Objective
from avc_casadi.problem._model import Problem as Problem
from avc_casadi.problem._model import Realism as Realism
from avc_casadi.problem._model import ScheduleSettings as ScheduleSettings
from avc_casadi.problem._model import Scope as Scope
from avc_casadi.problem._model import Stability as Stability
from avc_casadi.problem._model import Structure as Structure
from avc_casadi.problem._scene_file import CouplingChoice as CouplingChoice
from avc_casadi.problem._scene_file import Effect as Effect
from avc_casadi.problem._scene_file import Motion as Motion
from avc_casadi.problem._scene_file import Scene as Scene
