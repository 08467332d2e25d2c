"""What the simulators in C beside the tests share: to be compiled, and to be given numbers and arrays."""

import ctypes
import functools
import tempfile
from pathlib import Path

from hardware_bench import require, run, scratch

BUILD = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared")


def doubles(names):
    """A struct of that many doubles."""
    return type("Doubles", (ctypes.Structure,), {"_fields_": [(name, ctypes.c_double) for name in names]})


@functools.cache
def simulator(name):
    """The function `name` of `name`.c beside this file."""
    require("gcc")
    target = scratch() / f"{name}.so"
    run("gcc", *BUILD, str(Path(__file__).with_name(f"{name}.c")), "-lm", "-o", str(target))
    return getattr(ctypes.CDLL(str(target)), name)


def with_exported(files, source):
    """The library of an exported coupling, its files by name, and a source that calls it."""
    require("gcc")
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    sources = (str(folder / "avc_coupling.c"), str(folder / source))
    run("gcc", *BUILD, "-I", str(folder), *sources, "-lm", "-o", str(folder / "coupling.so"))
    return ctypes.CDLL(str(folder / "coupling.so"))


def pointers(*arrays):
    """The arrays of doubles as C takes them."""
    return [each.ctypes.data_as(ctypes.c_void_p) for each in arrays]
