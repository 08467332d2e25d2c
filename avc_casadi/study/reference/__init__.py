"""Optima of (11)-(12) to 50 digits, by other means than the methods that are held against them; needs mpmath."""

from avc_casadi.study.reference._optimum import MP as MP
from avc_casadi.study.reference._optimum import NUMBERS as NUMBERS
from avc_casadi.study.reference._optimum import damped_error as damped_error
from avc_casadi.study.reference._optimum import series_error as series_error
