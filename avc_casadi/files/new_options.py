"""Options of `avc new` for a device, its wall and its hands: a light module, which the help prints too."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Option:
    """One value of a problem file: its options, examples of it, its default, and what not knowing it costs.

    `drive` is the drive of the devices that have it: "force", "velocity", or empty where all do.
    """

    key: str
    drive: str
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
    def key_beside_device(self) -> str:
        """Its key, without the table [device], which an answer on a device need not name."""
        return self.key.removeprefix("device.")

    @property
    def table(self) -> str:
        """Its table."""
        return self.key.rpartition(".")[0]

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
ENCODER = _BY_KEY["device.encoder_resolution_m"]
WALL_DAMPING = _BY_KEY["environment.damping_ns_per_m"]
HANDS = tuple(option for option in EVERY if option.key.startswith("hands."))
CONTACT = _BY_KEY["contact.stiffness_n_per_m"]
CONTACT_DAMPING = _BY_KEY["contact.damping_ns_per_m"]
FORCE_OPTIONS = tuple(
    option for option in EVERY if option.drive != "velocity" and option is not RADIUS and option not in HANDS
)
"""Of a device that is commanded a force."""
VELOCITY_OPTIONS = tuple(
    option for option in EVERY if option.drive != "force" and option is not RADIUS and option not in HANDS
)
"""Of an admittance device."""
NEEDED_OF_VELOCITY = (
    _BY_KEY["device.drive_bandwidth_hz"],
    _BY_KEY["device.force_sensor.stiffness_n_per_m"],
    _BY_KEY["device.force_sensor.handle_mass_kg"],
)
"""Values without which there is no admittance device."""
SPANS = (*HANDS, CONTACT, CONTACT_DAMPING)
"""Values that may be a range."""
DAMPERS = (DAMPING, CONTACT_DAMPING)
"""Values that are written as 0 where they are not known."""

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
