"""Identification: logs of time, position and commanded force become a device file, each value with its interval."""

from avc_casadi.identification._device import device_text as device_text
from avc_casadi.identification._encoder import encoder_step_m as encoder_step_m
from avc_casadi.identification._evidence import Trial as Trial
from avc_casadi.identification._frequency import Response as Response
from avc_casadi.identification._identify import identify as identify
from avc_casadi.identification._model import Estimate as Estimate
from avc_casadi.identification._model import Identification as Identification
from avc_casadi.identification._model import Refusal as Refusal
from avc_casadi.identification._model import Shown as Shown
from avc_casadi.identification._read import read_columns as read_columns
from avc_casadi.identification._read import read_logs as read_logs
from avc_casadi.identification._record import Columns as Columns
from avc_casadi.identification._record import Record as Record
from avc_casadi.identification._terms import TERMS as TERMS
from avc_casadi.identification._terms import words_of as words_of
from avc_casadi.identification._told import identification_document as identification_document
from avc_casadi.identification._told import identification_text as identification_text
from avc_casadi.identification._units import Layout as Layout
from avc_casadi.identification._units import pairs_of as pairs_of
