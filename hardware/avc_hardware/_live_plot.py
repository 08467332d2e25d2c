"""Live plot: position, force and gains of the last seconds, in a window while a device is watched."""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Self

from avc_casadi import UnsupportedError
from avc_hardware._telemetry import TelemetrySample

# Drawing takes tens of milliseconds, in which no record is read: they wait on the line.
_EVERY_S = 0.2
_KEPT = 20_000
_ROWS: tuple[tuple[str, Callable[[TelemetrySample], float]], ...] = (
    ("position, mm", lambda sample: 1e3 * sample.position_m),
    ("force out of the wall, N", lambda sample: sample.force_n),
    ("stiffness k, N/m", lambda sample: sample.stiffness_n_per_m),
    ("interaction frequency, Hz", lambda sample: sample.frequency_hz),
)


class LivePlot:
    """A window that follows samples; use as a context manager.

    Attributes:
        figure: the matplotlib figure.
        closed: whether the user has closed the window.
    """

    def __init__(self, *, span_s: float = 10.0, figure: Any = None) -> None:
        """Open the window.

        Args:
            span_s: how many seconds are shown.
            figure: draw into this one in place of a window.

        Raises:
            UnsupportedError: this machine has no display, or matplotlib no way to open a window.
        """
        self.closed = False
        self._span_s = span_s
        self._samples: deque[TelemetrySample] = deque(maxlen=_KEPT)
        self._drawn = 0.0
        self._window = figure is None
        self.figure: Any = _window() if figure is None else figure
        self.figure.canvas.mpl_connect("close_event", self._close)
        self._axes = self.figure.subplots(len(_ROWS), 1, sharex=True)
        self._lines = [axes.plot([], [], linewidth=1)[0] for axes in self._axes]
        for axes, (label, _) in zip(self._axes, _ROWS, strict=True):
            axes.set_ylabel(label, fontsize="small")
            axes.grid(visible=True, alpha=0.3)
        self._axes[-1].set_xlabel("time since the device started, s")

    def take(self, sample: TelemetrySample) -> None:
        """Add a sample; the window is drawn anew a few times a second."""
        self._samples.append(sample)
        now = time.monotonic()
        if now - self._drawn >= _EVERY_S:
            self.draw()
            self._drawn = time.monotonic()

    def draw(self) -> None:
        """Draw what is known."""
        if not self._samples or self.closed:
            return
        end = self._samples[-1].time_s
        shown = [sample for sample in self._samples if end - self._span_s <= sample.time_s <= end]
        times = [sample.time_s for sample in shown]
        for axes, line, (_, value) in zip(self._axes, self._lines, _ROWS, strict=True):
            line.set_data(times, [value(sample) for sample in shown])
            axes.relim()
            axes.autoscale_view(scalex=False)
        self._axes[0].set_xlim(end - self._span_s, end)
        if self._window:
            self.figure.canvas.draw_idle()
            self.figure.canvas.flush_events()

    def _close(self, _event: object) -> None:
        self.closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._window and not self.closed:
            import matplotlib.pyplot as plt  # noqa: PLC0415 - only where there is a window

            plt.close(self.figure)


def _window() -> Any:
    import matplotlib.pyplot as plt  # noqa: PLC0415 - slow, and not needed without a plot

    on_x11 = sys.platform not in {"win32", "darwin"}
    if on_x11 and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UnsupportedError(
            "this machine has no display for --plot; write a log instead (--out log.csv, or --out log.mcap for "
            "Foxglove), or log in with `ssh -X`"
        )
    figure = plt.figure("avc monitor", figsize=(9, 8))
    if figure.canvas.required_interactive_framework is None:
        plt.close(figure)
        raise UnsupportedError(
            f"matplotlib opens no window here (backend {plt.get_backend()}); install one: pip install PyQt6, and unset "
            "MPLBACKEND; or write a log instead (--out log.csv)"
        )
    figure.show()
    return figure
