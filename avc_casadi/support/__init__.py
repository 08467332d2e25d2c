"""What every room stands on: array types, finite JSON, interrupts, equality, tables and how results show themselves."""

from avc_casadi.support._arrays import BoolArray as BoolArray
from avc_casadi.support._arrays import ComplexArray as ComplexArray
from avc_casadi.support._arrays import Float32Array as Float32Array
from avc_casadi.support._arrays import FloatArray as FloatArray
from avc_casadi.support._arrays import IndexArray as IndexArray
from avc_casadi.support._display import Columns as Columns
from avc_casadi.support._display import Tabular as Tabular
from avc_casadi.support._display import columns_html as columns_html
from avc_casadi.support._display import data_frame as data_frame
from avc_casadi.support._display import short as short
from avc_casadi.support._interrupt import HeldInterrupt as HeldInterrupt
from avc_casadi.support._interrupt import reraise_interrupt as reraise_interrupt
from avc_casadi.support._interrupt import starting_processes as starting_processes
from avc_casadi.support._interrupt import uninterrupted as uninterrupted
from avc_casadi.support._json import json_text as json_text
from avc_casadi.support._json import plain as plain
from avc_casadi.support._same import Comparable as Comparable
from avc_casadi.support._same import same as same
from avc_casadi.support._table import ROWS_SHOWN as ROWS_SHOWN
from avc_casadi.support._table import Cell as Cell
from avc_casadi.support._table import Table as Table
from avc_casadi.support._table import counts_text as counts_text
from avc_casadi.support._table import number as number
from avc_casadi.support._table import sample_rows as sample_rows
from avc_casadi.support._table import text_table as text_table
