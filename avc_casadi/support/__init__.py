"""What every room stands on: array types, finite JSON, interrupts."""

from avc_casadi.support._arrays import BoolArray as BoolArray
from avc_casadi.support._arrays import ComplexArray as ComplexArray
from avc_casadi.support._arrays import Float32Array as Float32Array
from avc_casadi.support._arrays import FloatArray as FloatArray
from avc_casadi.support._arrays import IndexArray as IndexArray
from avc_casadi.support._interrupt import HeldInterrupt as HeldInterrupt
from avc_casadi.support._json import json_text as json_text
from avc_casadi.support._json import plain as plain
