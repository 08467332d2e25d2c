"""What the simulators in C beside the tests share: to be compiled, and to be given numbers and arrays."""

import ctypes
import functools
from pathlib import Path

from hardware_bench import require, run, scratch


def doubles(names):
    """A struct of that many doubles."""
    return type("Doubles", (ctypes.Structure,), {"_fields_": [(name, ctypes.c_double) for name in names]})


@functools.cache
def simulator(name):
    """The function `name` of `name`.c beside this file."""
    require("gcc")
    target = scratch() / f"{name}.so"
    flags = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared")
    run("gcc", *flags, str(Path(__file__).with_name(f"{name}.c")), "-lm", "-o", str(target))
    return getattr(ctypes.CDLL(str(target)), name)


def pointers(*arrays):
    """The arrays of doubles as C takes them."""
    return [each.ctypes.data_as(ctypes.c_void_p) for each in arrays]
