"""Methods that find gains which do not vary with frequency."""

from avc_casadi.design.constant._static import StaticCoupling as StaticCoupling
from avc_casadi.design.constant._static import solve_static as solve_static
from avc_casadi.design.constant._static import static_coupling as static_coupling
from avc_casadi.design.constant._static_tuned import TUNED_MARGIN_SHARE as TUNED_MARGIN_SHARE
from avc_casadi.design.constant._static_tuned import Budget as Budget
from avc_casadi.design.constant._static_tuned import StaticTuned as StaticTuned
from avc_casadi.design.constant._static_tuned import solve_static_tuned as solve_static_tuned
from avc_casadi.design.constant._static_tuned import tune_static as tune_static
from avc_casadi.design.constant._static_tuned import tuned_margin as tuned_margin
