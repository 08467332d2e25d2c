"""Passivity of the sampled loop: exact margins over bands, closed regions, Llewellyn's condition."""

from avc_casadi.passivity._handle_port import HandlePort as HandlePort
from avc_casadi.passivity._handle_port import handle_port as handle_port
from avc_casadi.passivity._handle_port import least_loss_ns_per_m as least_loss_ns_per_m
from avc_casadi.passivity._llewellyn import largest_llewellyn_stiffness as largest_llewellyn_stiffness
from avc_casadi.passivity._llewellyn import llewellyn_margin as llewellyn_margin
from avc_casadi.passivity._perceived import impedance_at_handle as impedance_at_handle
from avc_casadi.passivity._perceived import perceived_real as perceived_real
from avc_casadi.passivity._perceived import perceived_worst as perceived_worst
from avc_casadi.passivity._port_worst import CouplingSlack as CouplingSlack
from avc_casadi.passivity._port_worst import PortWorst as PortWorst
from avc_casadi.passivity._port_worst import RenderingSlack as RenderingSlack
from avc_casadi.passivity._port_worst import frequencies_hz as frequencies_hz
from avc_casadi.passivity._port_worst import port_worst as port_worst
from avc_casadi.passivity._port_worst import wave as wave
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
