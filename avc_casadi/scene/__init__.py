"""Scenes: the closed loop in time, simulated with the listed effects only."""

from avc_casadi.scene._accuracy import IntegratorAccuracy as IntegratorAccuracy
from avc_casadi.scene._accuracy import integrator_accuracy as integrator_accuracy
from avc_casadi.scene._compile import CompiledScene as CompiledScene
from avc_casadi.scene._compile import compile_scene as compile_scene
from avc_casadi.scene._execute import execute as execute
from avc_casadi.scene._explain import Explanation as Explanation
from avc_casadi.scene._explain import explain as explain
from avc_casadi.scene._gains import NO_COUPLING as NO_COUPLING
from avc_casadi.scene._gains import Gains as Gains
from avc_casadi.scene._gains import gains_at as gains_at
from avc_casadi.scene._judge import CRITERION as CRITERION
from avc_casadi.scene._judge import Judgement as Judgement
from avc_casadi.scene._judge import judge as judge
from avc_casadi.scene._ledger import Ledger as Ledger
from avc_casadi.scene._run import Run as Run
from avc_casadi.scene._screen import Screening as Screening
from avc_casadi.scene._screen import screen as screen
from avc_casadi.scene._simulate import simulate as simulate
from avc_casadi.scene._simulate import simulate_batch as simulate_batch
from avc_casadi.scene.effects import KINDS as KINDS
from avc_casadi.scene.effects import Hand as Hand
