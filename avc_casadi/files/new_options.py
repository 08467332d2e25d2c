"""Options of `avc new` for a device, its wall and its hands: a light module, which the help prints too."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Option:
    """One value of a problem file."""

    key: str
    option: str
    text: str
    examples: tuple[str, str]
    turning: str = ""
    default: str = ""
    cost: str = ""

    @property
    def names(self) -> tuple[str, str]:
        """Its options, of a linear and of a rotary device."""
        return self.option, self.turning or self.option


RADIUS = Option("device.handle_radius_m", "--radius", "radius at which a hand holds what turns", ("20 mm",) * 2)
MASS = Option("device.mass_kg", "--mass", "mass or inertia", ("120 g", "300 g.cm2"), "--inertia")
DAMPING = Option(
    "device.damping_ns_per_m",
    "--damping",
    "viscous damping",
    ("0.8 N.s/m", "0.1 mN.m.s/rad"),
    cost="taken as 0, the cautious end: what it damps is not counted on",
)
RATE = Option(
    "device.sample_time_s", "--rate", "sampling rate of the loop, or its sample time", ("1 kHz",) * 2, default="1 kHz"
)
DELAY = Option(
    "device.delay_samples",
    "--delay",
    "delay from measurement to force, on top of the hold",
    ("2 ms", "1 sample"),
    default="1 sample",
)
OPTIONS = (
    MASS,
    DAMPING,
    RATE,
    DELAY,
    Option(
        "device.coulomb_friction_n",
        "--friction",
        "dry friction",
        ("0.1 N", "2 mN.m"),
        cost="taken as 0, the cautious end: hands are asked to settle without it",
    ),
    Option(
        "device.encoder_resolution_m",
        "--encoder",
        "step of the encoder, or counts on a way",
        ("55 um, or 450 dpi", "4096 counts"),
        cost="taken as exact: buzz between two steps is not seen",
    ),
    Option(
        "device.max_force_n",
        "--max-force",
        "largest force or torque of the actuator",
        ("8 N", "200 mN.m"),
        "--max-torque",
        cost="taken as without limit: where nothing is stiffer is not seen",
    ),
    Option(
        "device.amplifier_bandwidth_hz",
        "--amplifier",
        "bandwidth of the amplifier",
        ("1 kHz",) * 2,
        cost="taken as ideal: the loop may buzz with a lag that is there",
    ),
    Option("environment.stiffness_n_per_m", "--wall", "stiffness of the wall", ("3 kN/m", "1 N.m/rad")),
    Option(
        "environment.damping_ns_per_m", "--wall-damping", "damping of the wall", ("0 N.s/m", "0 N.m.s/rad"), default="0"
    ),
)
HANDS = (
    Option("hands.mass_kg", "--hand-mass", "mass or inertia of what holds it", ("0.5 to 2 kg", "1 to 9 g.m2")),
    Option(
        "hands.damping_ns_per_m", "--hand-damping", "damping of what holds it", ("5 to 40 N.s/m", "0.1 to 1 N.m.s/rad")
    ),
    Option(
        "hands.stiffness_n_per_m",
        "--hand-stiffness",
        "stiffness of what holds it",
        ("200 to 2000 N/m", "5 to 50 N.m/rad"),
    ),
)
EVERY = (RADIUS, *OPTIONS, *HANDS)

HOLDS = {
    "grip": "the hands of a file without [hands], assumed: 0.05 to 0.3 kg, 3 to 20 N.s/m, 200 to 800 N/m at the handle",
    "wheel": "hands at the rim: those of a grip there",
    "stylus": "those of a grip; hands on a stylus (15 subjects of Fu and Cavusoglu 2012) must settle too",
    "fingertip": "one finger, assumed: lighter and less damped than a hand that holds",
    "foot": "no impedance of feet is known here: its ranges must be given",
    "other": "by its ranges",
}
"""What holds a device, and the hands of each."""
OWN_RANGES = ("foot", "other")
"""Holds whose ranges must be given."""
