"""What a device is declared to have beyond mass, damping and sample time."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from avc_casadi.problem._model import Problem


def declared(problem: Problem) -> tuple[str, ...]:
    """Name everything that makes the device more than a mass with a damper that is known exactly and never late.

    Args:
        problem: a validated problem.

    Returns:
        Dotted keys, for example ``device.delay_samples`` and ``device.range.mass_kg``, in the order of the file. A verb
        names those of them that it does not use.
    """
    device, range_ = problem.device, problem.device.range
    whole = set(type(device).model_fields) - {"mass_kg", "damping_ns_per_m", "sample_time_s", "range"}
    # These say nothing alone.
    if device.amplifier_bandwidth_hz is None:
        whole.discard("amplifier_order")
    if device.resonance is None:
        whole.discard("encoder_at")
    values = {key: (getattr(device, key), field.default) for key, field in type(device).model_fields.items()}
    found = [f"device.{key}" for key, (value, ideal) in values.items() if key in whole and value != ideal]
    found += [
        f"device.range.{key}"
        for key in type(range_).model_fields
        if key != "resonance" and getattr(range_, key) is not None
    ]
    mode = range_.resonance
    found += [f"device.range.resonance.{key}" for key in type(mode).model_fields if getattr(mode, key) is not None]
    return tuple(found)
