"""Scenes: the closed loop in time, simulated with the listed effects only."""

from avc_casadi.scene._accuracy import IntegratorAccuracy as IntegratorAccuracy
from avc_casadi.scene._accuracy import integrator_accuracy as integrator_accuracy
from avc_casadi.scene._compile import CompiledScene as CompiledScene
from avc_casadi.scene._compile import compile_scene as compile_scene
from avc_casadi.scene._execute import Engine as Engine
from avc_casadi.scene._execute import execute as execute
from avc_casadi.scene._explain import Explanation as Explanation
from avc_casadi.scene._explain import explain as explain
from avc_casadi.scene._explain import ns_per_step as ns_per_step
from avc_casadi.scene._judge import CRITERION as CRITERION
from avc_casadi.scene._judge import Judgement as Judgement
from avc_casadi.scene._judge import judge as judge
from avc_casadi.scene._ledger import Ledger as Ledger
from avc_casadi.scene._ledger import energy_ledger as energy_ledger
from avc_casadi.scene._motion import target_of as target_of
from avc_casadi.scene._native import NativeScene as NativeScene
from avc_casadi.scene._native import compiler as compiler
from avc_casadi.scene._run import Run as Run
from avc_casadi.scene._screen import Screening as Screening
from avc_casadi.scene._screen import screen as screen
from avc_casadi.scene._simulate import AnyGains as AnyGains
from avc_casadi.scene._simulate import compile_for as compile_for
from avc_casadi.scene._simulate import held_by as held_by
from avc_casadi.scene._simulate import settled as settled
from avc_casadi.scene._simulate import simulate as simulate
from avc_casadi.scene._simulate import simulate_batch as simulate_batch
