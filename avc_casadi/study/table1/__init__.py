"""The paper's experiment with simulated people: Table 1."""

from avc_casadi.study.table1._adversary import WIDER_BOUNDS as WIDER_BOUNDS
from avc_casadi.study.table1._adversary import WorstCase as WorstCase
from avc_casadi.study.table1._adversary import worst_case as worst_case
from avc_casadi.study.table1._calibration import calibrated_stiffness as calibrated_stiffness
from avc_casadi.study.table1._calibration import expected_share as expected_share
from avc_casadi.study.table1._calibration import share_without_coupling as share_without_coupling
from avc_casadi.study.table1._calibration import with_wall as with_wall
from avc_casadi.study.table1._campaign import run_campaign as run_campaign
from avc_casadi.study.table1._paper import PAPER as PAPER
from avc_casadi.study.table1._table import DEFAULT_HANDS as DEFAULT_HANDS
from avc_casadi.study.table1._table import DEFAULT_SEED as DEFAULT_SEED
from avc_casadi.study.table1._table import table1 as table1
from avc_casadi.study.table1._table import table1_study as table1_study
