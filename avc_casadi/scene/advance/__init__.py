"""From one sample to the next: the integrators of the continuous part."""

from avc_casadi.scene.advance._advance import Advance as Advance
from avc_casadi.scene.advance._advance import Drive as Drive
from avc_casadi.scene.advance._advance import MatrixExponential as MatrixExponential
from avc_casadi.scene.advance._friction import TaylorSeries as TaylorSeries
from avc_casadi.scene.advance._layout import Layout as Layout
from avc_casadi.scene.advance._projected import Projected as Projected
from avc_casadi.scene.advance._runge_kutta import RungeKutta as RungeKutta
from avc_casadi.scene.advance._split import Split as Split
from avc_casadi.scene.advance._split import column as column
