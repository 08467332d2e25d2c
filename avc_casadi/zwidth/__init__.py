"""Z-width: the range of walls that a device can render passively, or stably with and without a hand."""

from avc_casadi.zwidth._llewellyn_table import LlewellynTable as LlewellynTable
from avc_casadi.zwidth._llewellyn_table import llewellyn_table as llewellyn_table
from avc_casadi.zwidth._region import Curve as Curve
from avc_casadi.zwidth._region import ZWidth as ZWidth
from avc_casadi.zwidth._region import zwidth as zwidth
from avc_casadi.zwidth._rendered import rendered_wall as rendered_wall
