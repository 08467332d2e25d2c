"""avc-casadi: design, certify, simulate and deploy adaptive virtual couplings for haptic devices."""

from avc_casadi._errors import AvcError as AvcError
from avc_casadi._errors import Fault as Fault
from avc_casadi._errors import InputError as InputError
from avc_casadi._errors import LinkError as LinkError
from avc_casadi._errors import MissingExtraError as MissingExtraError
from avc_casadi._errors import UnsupportedError as UnsupportedError

__version__ = "0.1.0"
