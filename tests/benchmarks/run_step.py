"""A step of the control computer played from its initial state."""

import numpy as np


def run_step(step, inputs):
    """Its outputs at every tick, by name."""
    rows = np.atleast_2d(np.asarray(inputs, dtype=np.float64))
    played = step.function.mapaccum("run", rows.shape[1])(np.array(step.initial), rows, np.zeros((0, rows.shape[1])))
    return dict(zip(step.outputs, played[1].full(), strict=True))
