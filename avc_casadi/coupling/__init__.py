"""The coupling: gains against frequency, their look-up, thinning and files."""

from avc_casadi.coupling._gain_file import gain_csv as gain_csv
from avc_casadi.coupling._gain_file import gain_document as gain_document
from avc_casadi.coupling._gain_file import read_gains as read_gains
from avc_casadi.coupling._gain_file import write_gains as write_gains
from avc_casadi.coupling._gains import NO_COUPLING as NO_COUPLING
from avc_casadi.coupling._gains import Gains as Gains
from avc_casadi.coupling._gains import gains_at as gains_at
from avc_casadi.coupling._interpolation import gain_rows as gain_rows
from avc_casadi.coupling._interpolation import interpolate as interpolate
from avc_casadi.coupling._interpolation import row_slopes as row_slopes
from avc_casadi.coupling._interpolation import single_ln as single_ln
from avc_casadi.coupling._reduction import ReducedRows as ReducedRows
from avc_casadi.coupling._reduction import reduce_rows as reduce_rows
from avc_casadi.coupling._scene_table import GainTable as GainTable
from avc_casadi.coupling._schedule import GainSchedule as GainSchedule
from avc_casadi.coupling._schedule import Status as Status
from avc_casadi.coupling._schedule import gain_schedule as gain_schedule
