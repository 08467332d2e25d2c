"""Certificates: which claim a gain table meets, under which model, with what margin and where."""

from avc_casadi.certificate._certificate import TITLES as TITLES
from avc_casadi.certificate._certificate import Certificate as Certificate
from avc_casadi.certificate._certificate import Level as Level
from avc_casadi.certificate._certificate import LevelResult as LevelResult
from avc_casadi.certificate._certify import certify as certify
