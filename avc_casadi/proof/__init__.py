"""Proofs about the loop over whole sets of hands, in arithmetic that encloses every rounding."""

from avc_casadi.proof._interval import ComplexInterval as ComplexInterval
from avc_casadi.proof._interval import Interval as Interval
from avc_casadi.proof._interval import cosine as cosine
from avc_casadi.proof._interval import matrix_product as matrix_product
from avc_casadi.proof._interval import sine as sine
