"""Diagnosis: a log of a loop that buzzes, its oscillation, the nearest single cause, and what would cure it."""

from avc_casadi.diagnosis._causes import CAUSES as CAUSES
from avc_casadi.diagnosis._diagnose import diagnose as diagnose
from avc_casadi.diagnosis._law import Law as Law
from avc_casadi.diagnosis._log import Ticks as Ticks
from avc_casadi.diagnosis._model import Cure as Cure
from avc_casadi.diagnosis._model import Diagnosis as Diagnosis
from avc_casadi.diagnosis._model import Measured as Measured
from avc_casadi.diagnosis._model import Trace as Trace
from avc_casadi.diagnosis._oscillation import Oscillation as Oscillation
from avc_casadi.diagnosis._told import cure_text as cure_text
from avc_casadi.diagnosis._told import diagnosis_document as diagnosis_document
from avc_casadi.diagnosis._told import diagnosis_text as diagnosis_text
from avc_casadi.diagnosis._told import shares_text as shares_text
