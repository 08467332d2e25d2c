"""Trade-off study: what each guarantee costs in realism, and what adaptation wins over constant gains."""

from avc_casadi.study.pareto._study import Pareto as Pareto
from avc_casadi.study.pareto._study import Point as Point
from avc_casadi.study.pareto._study import pareto as pareto
from avc_casadi.study.pareto._variants import Study as Study
from avc_casadi.study.pareto._variants import Variant as Variant
from avc_casadi.study.pareto._variants import variants as variants
