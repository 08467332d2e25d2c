"""Passivity of the sampled loop: exact margins over bands, closed regions, Llewellyn's condition."""

from avc_casadi.passivity._llewellyn import largest_llewellyn_stiffness as largest_llewellyn_stiffness
from avc_casadi.passivity._llewellyn import llewellyn_margin as llewellyn_margin
from avc_casadi.passivity._regions import largest_lead_for_all_frequencies as largest_lead_for_all_frequencies
from avc_casadi.passivity._regions import passive_limit_n_per_m as passive_limit_n_per_m
from avc_casadi.passivity._sampled import RIGID as RIGID
from avc_casadi.passivity._sampled import Fractions as Fractions
from avc_casadi.passivity._sampled import SampledLoop as SampledLoop
from avc_casadi.passivity._sampled import Values as Values
from avc_casadi.passivity._sampled import fractions as fractions
from avc_casadi.passivity._sampled import real_part as real_part
from avc_casadi.passivity._sampled import size_of_terms as size_of_terms
from avc_casadi.passivity._worst import RELATIVE_TOLERANCE as RELATIVE_TOLERANCE
from avc_casadi.passivity._worst import WorstMargin as WorstMargin
from avc_casadi.passivity._worst import worst_margin as worst_margin
