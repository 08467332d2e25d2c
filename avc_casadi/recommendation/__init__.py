"""Which coupling to start with, how stiff a wall can be, and how real it feels."""

from avc_casadi.recommendation._designs import COUPLINGS as COUPLINGS
from avc_casadi.recommendation._designs import CandidateName as CandidateName
from avc_casadi.recommendation._designs import Design as Design
from avc_casadi.recommendation._designs import design as design
from avc_casadi.recommendation._designs import physical_wall as physical_wall
from avc_casadi.recommendation._designs import tuning_problem as tuning_problem
from avc_casadi.recommendation._error_curve import error_curve as error_curve
from avc_casadi.recommendation._helps import Help as Help
from avc_casadi.recommendation._helps import what_would_help as what_would_help
from avc_casadi.recommendation._hopeless import hopeless as hopeless
from avc_casadi.recommendation._reach import reach as reach
from avc_casadi.recommendation._reach import tuned as tuned
from avc_casadi.recommendation._reach import with_observer as with_observer
from avc_casadi.recommendation._recommend import Recommendation as Recommendation
from avc_casadi.recommendation._recommend import judged_as_recommended as judged_as_recommended
from avc_casadi.recommendation._recommend import recommend as recommend
from avc_casadi.recommendation._stiffest import stiffest as stiffest
from avc_casadi.recommendation._told import conclusion_lines as conclusion_lines
from avc_casadi.recommendation._told import gains_line as gains_line
from avc_casadi.recommendation._told import rest_line as rest_line
