"""Design methods by name: from a problem to gains."""

from avc_casadi.design._methods import METHODS as METHODS
from avc_casadi.design._methods import Method as Method
from avc_casadi.design._methods import MethodName as MethodName
from avc_casadi.design._rows import GainArrays as GainArrays
from avc_casadi.design._rows import admissible as admissible
from avc_casadi.design._rows import best_candidate as best_candidate
from avc_casadi.design._scene_coupling import scene_coupling as scene_coupling
from avc_casadi.design._scene_coupling import scene_gains as scene_gains
from avc_casadi.design._scene_coupling import scene_notes as scene_notes
from avc_casadi.design._scene_coupling import screen as screen
from avc_casadi.design._scene_coupling import simulate as simulate
from avc_casadi.design._solve import method_named as method_named
from avc_casadi.design._solve import solve as solve
