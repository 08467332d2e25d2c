"""Methods that solve (11)-(12) at each frequency on its own."""

from avc_casadi.design.pointwise._arcs import real_roots as real_roots
from avc_casadi.design.pointwise._backends import BACKENDS as BACKENDS
from avc_casadi.design.pointwise._backends import EDGES as EDGES
from avc_casadi.design.pointwise._backends import SOLVERS as SOLVERS
from avc_casadi.design.pointwise._backends import backend as backend
from avc_casadi.design.pointwise._closed_form import Projection as Projection
from avc_casadi.design.pointwise._closed_form import project as project
from avc_casadi.design.pointwise._closed_form import solve_closed_form as solve_closed_form
from avc_casadi.design.pointwise._direct import EXCESS_TOLERANCE as EXCESS_TOLERANCE
from avc_casadi.design.pointwise._direct import excess_error as excess_error
from avc_casadi.design.pointwise._direct import solve_direct as solve_direct
from avc_casadi.design.pointwise._edge_search import edge_search_gains as edge_search_gains
from avc_casadi.design.pointwise._exact import exact_gains as exact_gains
from avc_casadi.design.pointwise._exact import solve_exact as solve_exact
from avc_casadi.design.pointwise._nlp import coupling_nlp as coupling_nlp
from avc_casadi.design.pointwise._nlp import nlp_parameters as nlp_parameters
from avc_casadi.design.pointwise._nlp_solver import nlp_gains as nlp_gains
from avc_casadi.design.pointwise._nlp_solver import nlp_solvers as nlp_solvers
from avc_casadi.design.pointwise._optimality import KKT_TOLERANCE as KKT_TOLERANCE
from avc_casadi.design.pointwise._optimality import optimality as optimality
