"""The paper's experiment with simulated people, and how real a wall can feel while it stays stable."""

from avc_casadi.study._binomial import exact_interval as exact_interval
from avc_casadi.study._calibration import calibrated_stiffness as calibrated_stiffness
from avc_casadi.study._calibration import expected_share as expected_share
from avc_casadi.study._calibration import with_wall as with_wall
from avc_casadi.study._designs import COUPLINGS as COUPLINGS
from avc_casadi.study._designs import Coupling as Coupling
from avc_casadi.study._designs import Design as Design
from avc_casadi.study._designs import design as design
from avc_casadi.study._designs import physical_wall as physical_wall
from avc_casadi.study._designs import tuning_problem as tuning_problem
from avc_casadi.study._paper import PAPER as PAPER
from avc_casadi.study._subjects import Subjects as Subjects
from avc_casadi.study._subjects import draw_subjects as draw_subjects
from avc_casadi.study._table import DEFAULT_HANDS as DEFAULT_HANDS
from avc_casadi.study._table import DEFAULT_SEED as DEFAULT_SEED
from avc_casadi.study._table import table1 as table1
from avc_casadi.study._trial import MOTIONS as MOTIONS
from avc_casadi.study._trial import Conditions as Conditions
