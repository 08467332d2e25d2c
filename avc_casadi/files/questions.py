"""Questions of `avc new` on a device, its wall and the hands; a light module, as the help prints it too."""

from __future__ import annotations

from dataclasses import dataclass

from avc_casadi._util.units import CAP_MASS, FORCE, FORCES, Wording


@dataclass(frozen=True)
class Question:
    """One value of a problem file.

    Attributes:
        key: dotted, of a linear device.
        option: of the command line.
        turning: option of a rotary device; empty where it is the same.
        unit: of a linear device.
        asks: the question.
        examples: answers, of a linear and of a rotary device.
        default: answer by Enter; empty where there is none.
        cost: consequence of not knowing it; empty where it is required.
        taken: value in the file in its place; None where the key is left out.
    """

    key: str
    option: str
    turning: str
    unit: str
    asks: str | Wording
    examples: tuple[str, str]
    default: str = ""
    cost: str = ""
    taken: float | None = None

    @property
    def names(self) -> tuple[str, str]:
        """Its options, of a linear and of a rotary device."""
        return self.option, self.turning or self.option


RADIUS = Question(
    "device.handle_radius_m", "--radius", "", "m", "Radius at which it is held, from the axis", ("20 mm", "20 mm")
)
"""Question for a rotary device only."""

QUESTIONS = (
    Question(
        "device.mass_kg",
        "--mass",
        "--inertia",
        "kg",
        Wording.of(lambda: f"{CAP_MASS} that the hand moves, at the handle"),
        ("120 g", "300 g.cm2"),
    ),
    Question(
        "device.damping_ns_per_m",
        "--damping",
        "",
        "N.s/m",
        "Viscous damping",
        ("0.8 N.s/m", "0.1 mN.m.s/rad"),
        "unknown",
        "taken as 0, the cautious end: what it damps is not counted on",
        0.0,
    ),
    Question(
        "device.sample_time_s",
        "--rate",
        "",
        "s",
        Wording.of(lambda: f"Rate at which {FORCES} are sent, or the time between two"),
        ("1 kHz", "1 kHz"),
        "1 kHz",
    ),
    Question(
        "device.delay_samples",
        "--delay",
        "",
        "samples",
        Wording.of(lambda: f"Delay from measurement to {FORCE}, beside the sample that a {FORCE} is held for"),
        ("2 ms", "1 sample"),
        "1 sample",
        "taken as 0: the loop may buzz with a delay that is there",
    ),
    Question(
        "device.coulomb_friction_n",
        "--friction",
        "",
        "N",
        "Dry friction",
        ("0.1 N", "2 mN.m"),
        "unknown",
        "taken as 0, the cautious end: hands are asked to settle without it",
    ),
    Question(
        "device.encoder_resolution_m",
        "--encoder",
        "",
        "m",
        "Step of the encoder, or counts on a way",
        ("55 um, or 450 dpi", "4096 counts"),
        "unknown",
        "taken as exact: buzz between two steps is not seen",
    ),
    Question(
        "device.max_force_n",
        "--max-force",
        "--max-torque",
        "N",
        Wording.of(lambda: f"Largest {FORCE} of the actuator"),
        ("8 N", "200 mN.m"),
        "unknown",
        "taken as without limit: where nothing is stiffer is not seen",
    ),
    Question(
        "device.amplifier_bandwidth_hz",
        "--amplifier",
        "",
        "Hz",
        "Bandwidth of the amplifier",
        ("1 kHz", "1 kHz"),
        "unknown",
        "taken as ideal: the loop may buzz with a lag that is there",
    ),
    Question(
        "environment.stiffness_n_per_m",
        "--wall",
        "",
        "N/m",
        "Stiffness of the wall that is wanted",
        ("3 kN/m", "1 N.m/rad"),
    ),
    Question(
        "environment.damping_ns_per_m",
        "--wall-damping",
        "",
        "N.s/m",
        "Damping of that wall",
        ("0 N.s/m", "0 N.m.s/rad"),
        "0",
    ),
)
"""Questions in their order."""

HOLDS = {
    "grip": "the hands of a file without [hands], assumed: 0.05 to 0.3 kg, 3 to 20 N.s/m, 200 to 800 N/m at the handle",
    "wheel": "hands at the rim: those of a grip there",
    "stylus": "those of a grip; hands on a stylus (15 subjects of Fu and Cavusoglu 2012) must settle too",
    "fingertip": "one finger, assumed: lighter and less damped than a hand that holds",
    "foot": "no impedance of feet is known here: its ranges must be given",
    "other": "by its ranges",
}
"""Holds of a device, and the hands of each."""
OWN_RANGES = ("foot", "other")
"""Holds with ranges of one's own."""

HAND_RANGES = (
    Question(
        "hands.mass_kg",
        "--hand-mass",
        "",
        "kg",
        Wording.of(lambda: f"{CAP_MASS} of what holds it"),
        ("0.5 to 2 kg", "1 to 9 g.m2"),
    ),
    Question(
        "hands.damping_ns_per_m",
        "--hand-damping",
        "",
        "N.s/m",
        "Damping of what holds it",
        ("5 to 40 N.s/m", "0.1 to 1 N.m.s/rad"),
    ),
    Question(
        "hands.stiffness_n_per_m",
        "--hand-stiffness",
        "",
        "N/m",
        "Stiffness of what holds it",
        ("200 to 2000 N/m", "5 to 50 N.m/rad"),
    ),
)
"""Questions on one's own ranges of hands."""
