"""Design methods: from a problem to a gain schedule."""

from avc_casadi.design._closed_form import Projection as Projection
from avc_casadi.design._closed_form import project as project
from avc_casadi.design._gain_file import gain_csv as gain_csv
from avc_casadi.design._gain_file import gain_document as gain_document
from avc_casadi.design._gain_file import plain as plain
from avc_casadi.design._gain_file import read_gains as read_gains
from avc_casadi.design._gain_file import write_gains as write_gains
from avc_casadi.design._gains import ComplexArray as ComplexArray
from avc_casadi.design._gains import FloatArray as FloatArray
from avc_casadi.design._gains import GainSchedule as GainSchedule
from avc_casadi.design._gains import Status as Status
from avc_casadi.design._gains import gain_schedule as gain_schedule
from avc_casadi.design._interpolation import gain_rows as gain_rows
from avc_casadi.design._interpolation import interpolate as interpolate
from avc_casadi.design._interpolation import row_slopes as row_slopes
from avc_casadi.design._interpolation import single_ln as single_ln
from avc_casadi.design._reduction import ReducedRows as ReducedRows
from avc_casadi.design._reduction import reduce_rows as reduce_rows
from avc_casadi.design._solve import METHODS as METHODS
from avc_casadi.design._solve import Method as Method
from avc_casadi.design._solve import solve as solve
from avc_casadi.design._static import StaticCoupling as StaticCoupling
from avc_casadi.design._static import static_coupling as static_coupling
