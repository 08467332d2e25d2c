"""Flash, memory, stack and time of exported C.

``PYTHONPATH=tests:hardware python tests/benchmarks/exported_figures.py``

Prints the table of hardware/README.md. Needs avr-gcc, simavr, both cross compilers
and QEMU. Overwrites no file.
"""

from __future__ import annotations

from exported_bench import BOARDS, ran
from exported_cases import motions
from hardware_bench import believer, coupling, dense_believer
from script_arguments import script_arguments

from avc_casadi.model.runtime import Runtime

GUARD = "passivity-controller"
CASES = {
    "constant gains": (1, Runtime()),
    "the same, observer and guard": (1, Runtime(observer_mass_kg=0.25, guard=GUARD)),
    "state feedback, 3 states": (1, Runtime(state_feedback=believer(16))),
    "state feedback, 8 states": (1, Runtime(state_feedback=dense_believer(8))),
    "200 rows, `zero-crossing`": (200, Runtime("zero-crossing")),
    "200 rows, `fused`, guard": (200, Runtime("fused", guard=GUARD)),
}


def figures(board: str, rows: int, runtime: Runtime) -> str:
    """Return what one board needs: flash, memory, stack, and cycles where they are counted."""
    made = coupling(rows, largest=(300.0, 1e5, 50.0), runtime=runtime, encoder_resolution_m=2e-5, max_force_n=10.0)
    result = ran(board, made, motions(made)[:3, :100])
    text = f"{result.flash_bytes} / {result.state_bytes} / {result.stack_bytes}"
    return text + (f" / {result.cycles}" if result.cycles else "")


if __name__ == "__main__":
    script_arguments(__doc__)
    boards = [board for board in BOARDS if board != "ATmega328P"]
    print("| |", " | ".join(boards), "|")
    print("|---|" + "---|" * len(boards))
    for name, (rows, runtime) in CASES.items():
        print(f"| {name} |", " | ".join(figures(board, rows, runtime) for board in boards), "|", flush=True)
