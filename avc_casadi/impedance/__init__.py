"""The physics: every equation of the coupling once, for numpy, mpmath and CasADi."""

from avc_casadi.impedance._equations import SampleAngle as SampleAngle
from avc_casadi.impedance._equations import backward_difference as backward_difference
from avc_casadi.impedance._equations import coupling_gains as coupling_gains
from avc_casadi.impedance._equations import coupling_impedance as coupling_impedance
from avc_casadi.impedance._equations import delay_operator as delay_operator
from avc_casadi.impedance._equations import device_impedance as device_impedance
from avc_casadi.impedance._equations import environment_impedance as environment_impedance
from avc_casadi.impedance._equations import hold as hold
from avc_casadi.impedance._equations import perceived_impedance as perceived_impedance
from avc_casadi.impedance._equations import series as series
from avc_casadi.impedance._equations import spring_damper as spring_damper
from avc_casadi.impedance._equations import tustin as tustin
from avc_casadi.impedance._loop import Loop as Loop
from avc_casadi.impedance._loop import loop_at as loop_at
from avc_casadi.impedance._numbers import NUMPY as NUMPY
from avc_casadi.impedance._numbers import Complex as Complex
from avc_casadi.impedance._numbers import ComplexExpr as ComplexExpr
from avc_casadi.impedance._numbers import NumberSystem as NumberSystem
from avc_casadi.impedance._numbers import Real as Real
from avc_casadi.impedance._numbers import abs2 as abs2
from avc_casadi.impedance._numbers import casadi_numbers as casadi_numbers
from avc_casadi.impedance._numbers import mpmath_numbers as mpmath_numbers
from avc_casadi.impedance._paper_errors import ASSUMPTIONS as ASSUMPTIONS
from avc_casadi.impedance._paper_errors import PAPER_ERRORS as PAPER_ERRORS
from avc_casadi.impedance._paper_errors import Assumption as Assumption
from avc_casadi.impedance._paper_errors import PaperError as PaperError
