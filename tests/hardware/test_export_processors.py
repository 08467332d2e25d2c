"""The exported C on an 8-bit AVR, two Cortex-M and a 64-bit RISC-V, emulated: the bits of the scene's expressions."""

import numpy as np
import pytest
from exported_bench import BOARDS, Ran, ran
from exported_cases import drawn, motions
from hardware_bench import coupling
from reference_coupling import ReferenceCoupling

from avc_casadi._util.arrays import FloatArray
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime

# Observer, tank and a table; state feedback and guard; state feedback without; the fused estimator with all of it.
SMALL, ALL = (2, 16, 21), 17
CASES = [(board, seed, 110) for board in BOARDS if board != "ATmega2560" for seed in SMALL]
CASES += [(board, ALL, 50) for board in BOARDS if board not in ("ATmega328P", "Cortex-M0")]


def checked(board: str, made: Coupling, ways: FloatArray) -> Ran:
    devices = ReferenceCoupling(made, len(ways))
    expected = np.stack([devices.step(column) for column in ways.T], axis=1)
    result = ran(board, made, ways)
    assert (result.forces > 0).any()
    assert result.forces.tobytes() == expected.tobytes()
    return result


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(("board", "seed", "samples"), CASES)
def test_forces_have_the_bits_of_the_expressions(board: str, seed: int, samples: int) -> None:
    made = drawn(seed)
    result = checked(board, made, motions(made)[:, :samples])
    assert result.state_bytes <= 512
    assert result.stack_bytes <= 1200


@pytest.mark.thorough
def test_200_rows_fit_an_arduino_uno_and_stay_in_flash() -> None:
    """32 KB of flash, 2 KB of memory."""
    made = coupling(
        200,
        largest=(300.0, 1e5, 50.0),
        runtime=Runtime(estimator="zero-crossing", guard="passivity-controller"),
        encoder_resolution_m=2e-5,
    )
    result = checked("ATmega328P", made, motions(made)[:3, 50:130])
    assert result.flash_bytes > 200 * 5 * 4
    assert result.copied_bytes == 0
    assert result.program_bytes <= 32 * 1024
    assert result.state_bytes + result.stack_bytes <= 1024
