"""Options of `avc new` for a device, its wall and its hands: a light module, which the help prints too."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Option:
    """One value of a problem file: its options, examples of it, its default, and what not knowing it costs."""

    key: str
    option: str
    option_turning: str
    text: str
    example: str
    example_turning: str
    default: str
    cost: str

    @property
    def key_in_table(self) -> str:
        """Its key without that of its table."""
        return self.key.partition(".")[2]

    @property
    def names(self) -> tuple[str, str]:
        """Its options, of a linear and of a rotary device."""
        return self.option, self.option_turning or self.option

    @property
    def examples(self) -> tuple[str, str]:
        """Its examples, of a linear and of a rotary device."""
        return self.example, self.example_turning

    @property
    def shown_default(self) -> str:
        """Its default, as the help ends with it; empty where there is none."""
        return f" (default: {self.default})" if self.default else ""


with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as _text:
    EVERY = tuple(Option(**row) for row in csv.DictReader(_text))
_BY_KEY = {option.key: option for option in EVERY}
RADIUS = _BY_KEY["device.handle_radius_m"]
MASS = _BY_KEY["device.mass_kg"]
DAMPING = _BY_KEY["device.damping_ns_per_m"]
RATE = _BY_KEY["device.sample_time_s"]
DELAY = _BY_KEY["device.delay_samples"]
WALL_DAMPING = _BY_KEY["environment.damping_ns_per_m"]
HANDS = tuple(option for option in EVERY if option.key.startswith("hands."))
OPTIONS = tuple(option for option in EVERY if option is not RADIUS and option not in HANDS)

HOLDS = {
    "grip": "a hand, assumed: 0.05 to 0.3 kg, 3 to 20 N.s/m, 200 to 800 N/m at the handle, as without [hands]",
    "wheel": "a hand at the rim, with the values of a grip",
    "stylus": "a hand, as a grip; hands on a stylus (15 subjects of Fu and Cavusoglu 2012) must settle too",
    "fingertip": "a finger, assumed: lighter and less damped than a grip",
    "foot": "no built-in values: give the three ranges of --hand-...",
    "other": "no built-in values: give the three ranges of --hand-...",
}
"""What holds a device, and the hands of each."""
OWN_RANGES = ("foot", "other")
"""Holds whose ranges must be given."""
