"""Logs as arrays, NPZ and MAT: the declared size of a file is checked before any of it is read."""

from __future__ import annotations

import io
import math
import struct
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
import scipy.io

from avc_casadi._errors import InputError

MOST_BYTES = 2**27
_MOST_ARRAYS = 1000
_HEADER_BYTES, _COMPRESSED = 128, 15
_NUMBERS = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


def npy_array(stream: BinaryIO) -> Any:
    """Return the numeric array of an NPY file.

    Raises:
        ValueError: it is no NPY file, or declares more data than it holds.
    """
    content = stream.read(MOST_BYTES + 1)
    return _array(io.BytesIO(content), len(content))


def npz_arrays(stream: BinaryIO, file: str) -> dict[str, Any]:
    """Return the numeric arrays of an NPZ archive.

    Raises:
        InputError: it declares more data than is allowed.
        ValueError, zipfile.BadZipFile: it is no NPZ archive.
    """
    with zipfile.ZipFile(stream) as archive:
        members = [one for one in archive.infolist() if one.filename.endswith(".npy")]
        _bound(sum(one.file_size for one in members), len(members), file)
        found = {}
        for one in members:
            with archive.open(one) as member:
                found[one.filename.removesuffix(".npy")] = _array(member, one.file_size)
    return found


def _array(stream: Any, size: int) -> Any:
    version = np.lib.format.read_magic(stream)
    if version > (3, 0):
        raise ValueError(f"a member has format {version}, which is not known")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_columns, kind = read(stream)
    if kind.hasobject:
        return np.zeros(0)  # no numbers
    if math.prod(shape) * kind.itemsize > size:
        raise ValueError(f"a member of {size} bytes claims an array of shape {shape}")
    values = np.frombuffer(stream.read(), dtype=kind, count=math.prod(shape))
    return values.reshape(shape, order="F" if by_columns else "C")


def mat_arrays(stream: BinaryIO, file: str) -> Mapping[str, Any]:
    """Return the numeric arrays of a MAT file before version 7.3.

    Raises:
        InputError: it declares more data than is allowed.
        ValueError, NotImplementedError, scipy.io.matlab.MatReadError: it is no such MAT file.
    """
    plain: Any = io.BytesIO(_inflated(stream.read(MOST_BYTES + 1), file))
    held = scipy.io.whosmat(plain)
    sizes = {name: math.prod(map(int, shape)) for name, shape, kind in held if kind in _NUMBERS}
    _bound(8 * sum(sizes.values()), len(held), file)
    plain.seek(0)
    found = scipy.io.loadmat(plain, squeeze_me=True, variable_names=list(sizes))
    return {name: found[name] for name in sizes if name in found}


def _inflated(content: bytes, file: str) -> bytes:
    """Return a MAT file of version 5 with its compressed parts inflated; any other unchanged."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        _bound(len(content), 0, file)
        return content
    parts, at, left = [content[:_HEADER_BYTES]], _HEADER_BYTES, MOST_BYTES
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}2I", content, at)
        part = content[at : at + 8 + size]
        if kind == _COMPRESSED:
            try:
                part = zlib.decompressobj().decompress(part[8:], left + 1)
            except zlib.error as error:
                raise ValueError(f"a part of it cannot be unpacked: {error}") from error
        left -= len(part)
        _bound(MOST_BYTES - left, 0, file)
        parts.append(part)
        at += 8 + size
    return b"".join(parts)


def _bound(size: int, arrays: int, file: str) -> None:
    if size > MOST_BYTES or arrays > _MOST_ARRAYS:
        held = f"holds {size} bytes" if size > MOST_BYTES else f"holds {arrays} arrays"
        message = f"{held}; allowed: at most {MOST_BYTES} bytes in {_MOST_ARRAYS} arrays; cut it, or write it as CSV"
        raise InputError.of(message, file=file)
