"""Trade-off study: what each guarantee costs in realism, and what adaptation wins over constant gains."""

from avc_casadi.study.pareto._designs import Design as Design
from avc_casadi.study.pareto._designs import Study as Study
from avc_casadi.study.pareto._designs import designs as designs
from avc_casadi.study.pareto._study import Pareto as Pareto
from avc_casadi.study.pareto._study import Point as Point
from avc_casadi.study.pareto._study import pareto as pareto
