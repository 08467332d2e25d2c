"""Log: what `monitor` saw, as arrays in a file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from avc_casadi import InputError
from avc_hardware._device import MODES, DeviceStatus


def save_log(samples: Iterable[DeviceStatus], path: Path) -> int:
    """Write samples as an ``.npz`` file with one array a field; ``mode`` as its index in `MODES`.

    Args:
        samples: of `monitor`.
        path: file to write; its ending must be ``.npz``.

    Returns:
        Number of samples written.

    Raises:
        InputError: another ending, or the file cannot be written.
    """
    if path.suffix != ".npz":
        raise InputError.of("allowed: a name that ends in .npz", file=str(path))
    rows = list(samples)
    columns: dict[str, Any] = {
        field.name: np.array(
            [MODES.index(row.mode) if field.name == "mode" else getattr(row, field.name) for row in rows]
        )
        for field in fields(DeviceStatus)
    }
    try:
        np.savez_compressed(path, **columns)
    except OSError as error:
        raise InputError.of(f"cannot be written ({error.strerror})", file=str(path)) from error
    return len(rows)
