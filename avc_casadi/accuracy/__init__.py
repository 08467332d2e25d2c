"""What accuracy costs in time: methods and solvers, gain tables, grids of frequencies."""

from avc_casadi.accuracy._grids import GridMiss as GridMiss
from avc_casadi.accuracy._solvers import SolverCost as SolverCost
from avc_casadi.accuracy._study import Accuracy as Accuracy
from avc_casadi.accuracy._study import study_accuracy as study_accuracy
from avc_casadi.accuracy._tables import TableError as TableError
