"""The coupling: gains against frequency, what runs beside them, their look-up, thinning and files."""

from avc_casadi.coupling._coupling import CAPACITY_ROWS as CAPACITY_ROWS
from avc_casadi.coupling._coupling import THINNING as THINNING
from avc_casadi.coupling._coupling import Coupling as Coupling
from avc_casadi.coupling._coupling import schedule_of as schedule_of
from avc_casadi.coupling._coupling import thinned as thinned
from avc_casadi.coupling._coupling_file import check_sample_time as check_sample_time
from avc_casadi.coupling._coupling_file import coupling_document as coupling_document
from avc_casadi.coupling._coupling_file import read_coupling as read_coupling
from avc_casadi.coupling._coupling_file import write_coupling as write_coupling
from avc_casadi.coupling._gain_file import gain_csv as gain_csv
from avc_casadi.coupling._gain_file import gain_document as gain_document
from avc_casadi.coupling._gain_file import read_document as read_document
from avc_casadi.coupling._gain_file import read_gains as read_gains
from avc_casadi.coupling._gain_table import GainTable as GainTable
from avc_casadi.coupling._gains import NO_COUPLING as NO_COUPLING
from avc_casadi.coupling._gains import Gains as Gains
from avc_casadi.coupling._gains import gains_at as gains_at
from avc_casadi.coupling._interpolation import interpolate as interpolate
from avc_casadi.coupling._interpolation import single_ln as single_ln
from avc_casadi.coupling._reduction import ReducedRows as ReducedRows
from avc_casadi.coupling._reduction import reduce_rows as reduce_rows
from avc_casadi.coupling._runtime import RUNTIME_KINDS as RUNTIME_KINDS
from avc_casadi.coupling._runtime import Runtime as Runtime
from avc_casadi.coupling._schedule import GainSchedule as GainSchedule
from avc_casadi.coupling._schedule import Status as Status
from avc_casadi.coupling._schedule import gain_schedule as gain_schedule
