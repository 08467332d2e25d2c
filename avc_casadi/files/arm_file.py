"""An arm file: mechanism and workspace of a device with several axes, its electronics as in a device file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BeforeValidator, model_validator

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import MASS
from avc_casadi.files.catalogue import named_file
from avc_casadi.files.device_file import with_device
from avc_casadi.files.key_lines import KeyLines
from avc_casadi.files.toml_text import tables_of, text_of
from avc_casadi.model.device import Device
from avc_casadi.model.findings import checked
from avc_casadi.model.problem import Hands
from avc_casadi.model.quantity import Length, Mass, Quantity, Table, Text, ordered, refusal, shown
from avc_casadi.model.rules import DEVICE_RULES, Finding, Values, broken_rules, dotted

MECHANISMS = ("phantom", "five_bar", "gantry", "model")
"""Mechanism tables of an arm file, which has exactly one."""


def _numbers(value: Any, count: tuple[int, ...]) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple) or len(value) not in count:
        raise refusal(f"is {shown(value)}; allowed: {' or '.join(map(str, count))} numbers in brackets")
    return tuple(value)


def _three(value: Any) -> tuple[Any, ...]:
    return _numbers(value, (3,))


def _two(value: Any) -> tuple[Any, ...]:
    return _numbers(value, (2,))


def _two_or_three(value: Any) -> tuple[Any, ...]:
    return _numbers(value, (2, 3))


def _joints(value: Any) -> tuple[Any, ...]:
    return _numbers(value, tuple(range(2, 13)))


Inertia = Annotated[float, BeforeValidator(Quantity("kg.m2", 1e-12, 1e4))]
LinkLength = Annotated[float, BeforeValidator(Quantity("m", 1e-6, 10, zero=False))]
_Angle = Annotated[float, BeforeValidator(Quantity("deg", 1e-6, 360, signed=True))]
_Offset = Annotated[float, BeforeValidator(Quantity("m", 1e-6, 10, signed=True))]
_JointValue = Annotated[float, BeforeValidator(Quantity("rad or m", 1e-9, 100, signed=True))]
Inertias = Annotated[tuple[Inertia, Inertia, Inertia], BeforeValidator(_three)]
Masses = Annotated[tuple[Mass, Mass, Mass], BeforeValidator(_three)]
_Angles = Annotated[tuple[_Angle, _Angle], BeforeValidator(_two), AfterValidator(ordered)]
_Offsets = Annotated[tuple[_Offset, ...], BeforeValidator(_two_or_three)]
_JointValues = Annotated[tuple[_JointValue, ...], BeforeValidator(_joints)]


class PhantomLinks(Table):
    """A Phantom: base about the vertical, two links driven by a parallelogram.

    After Cavusoglu, Feygin and Tendick (2002), whose letters are given: forearm a, link parallel to the upper arm c,
    upper arm with its motor and counterweight be, link parallel to the forearm with motor and counterweight df. Axes
    of the inertias, about the centre of mass: x along the joints of the plane, y and z in it, as published.

    Attributes:
        upper_length_m: l1.
        forearm_length_m: l2, to the tip.
        parallel_length_m: l3, between the forearm's joints.
        angle_between_deg: range of q2 - q3, upper arm against forearm.
    """

    upper_length_m: LinkLength
    forearm_length_m: LinkLength
    parallel_length_m: LinkLength
    forearm_mass_kg: Mass
    parallel_mass_kg: Mass
    forearm_inertia_kgm2: Inertias
    parallel_inertia_kgm2: Inertias
    upper_inertia_kgm2: Inertias
    back_inertia_kgm2: Inertias
    base_inertia_kgm2: Inertia
    angle_between_deg: _Angles


class FiveBarLinks(Table):
    """A planar five-bar: two equal arms, each a proximal link on a motor and a distal one to the tip.

    Attributes:
        base_distance_m: between the two motor axes; 0 where they are one.
        proximal_length_m: a.
        distal_length_m: b.
        proximal_centre_m: of mass, from the motor axis.
        distal_centre_m: of mass, from the elbow.
        proximal_inertia_kgm2: about the centre of mass.
        distal_inertia_kgm2: about the centre of mass.
        motor_inertia_kgm2: rotor and hub, about the motor axis.
        tip_mass_kg: of the handle.
    """

    base_distance_m: Length
    proximal_length_m: LinkLength
    distal_length_m: LinkLength
    proximal_mass_kg: Mass
    distal_mass_kg: Mass
    proximal_centre_m: Length
    distal_centre_m: Length
    proximal_inertia_kgm2: Inertia
    distal_inertia_kgm2: Inertia
    motor_inertia_kgm2: Inertia = 0.0
    tip_mass_kg: Mass = 0.0


class GantryStages(Table):
    """Three slides at right angles: x carries y, y carries z.

    Attributes:
        stage_mass_kg: of each stage alone.
        drive_mass_kg: motor and transmission, reflected to each axis.
    """

    stage_mass_kg: Masses
    drive_mass_kg: Masses = (0.0, 0.0, 0.0)


class ModelFile(Table):
    """An external model: URDF or MJCF.

    Attributes:
        file: ``.urdf``, or ``.xml`` for MJCF; relative to the arm file.
        tip: link (URDF) or body (MJCF) at whose origin the hand holds the arm.
    """

    file: Text
    tip: Text


class Workspace(Table):
    """A box about the tip at home, axis by axis.

    Attributes:
        low_m: lowest corner, from the tip at home.
        high_m: highest corner.
    """

    low_m: _Offsets
    high_m: _Offsets


class TipDevice(Device):
    """The device at the tip; its mass depends on pose and direction."""

    mass_kg: Mass = 1.0


class ArmFile(Table):
    """A device of several axes.

    Attributes:
        name: catalogue name or file stem.
        title: one line.
        source: of the numbers; states which are assumed.
        device: properties at the tip, equal in every direction; its mass does not count.
        home: joint values at the centre of the workspace, rad or m.
        workspace: of the tip.
        hands: that hold it.
    """

    name: Text = ""
    title: Text = ""
    source: Text = ""
    device: TipDevice
    home: _JointValues
    workspace: Workspace
    hands: Hands = Hands()
    phantom: PhantomLinks | None = None
    five_bar: FiveBarLinks | None = None
    gantry: GantryStages | None = None
    model: ModelFile | None = None

    @model_validator(mode="after")
    def _keeps_the_rules(self) -> Self:
        broken = broken_rules(Values(self, type(self)), _RULES)
        if broken:
            raise refusal("\n".join(f"{dotted(path)}: {message}" for path, message in broken))
        return self


def load_arm(source: str | Path) -> ArmFile:
    """Load an arm file.

    Args:
        source: a path, or a name of the catalogue of arms, for example ``phantom-premium-1.5``.

    Raises:
        InputError: with every fault of the file at once, each with its line and key.

    Example:
        >>> avc.load_arm("phantom-premium-1.5").phantom.upper_length_m
        0.215
    """
    path, file = named_file(source, "arm"), str(source)
    if isinstance(path, str):
        raise InputError.of(path, file=file)
    text = text_of(path, "give the path of an arm file or the name of an arm from `avc list`")
    tables = _whole(tables_of(text, file), path.parent)
    result = [tables] if isinstance(tables, tuple) else checked(ArmFile, tables, path.stem, _RULES)
    if isinstance(result, ArmFile):
        return result
    lines = KeyLines(text.replace("\r\n", "\n"))
    raise InputError([Fault(file, lines[key], dotted(key), message) for key, message in result])


def _whole(tables: Mapping[str, Any], folder: Path) -> Mapping[str, Any] | Finding:
    """Replace a reference by the device, without its mass; make a model's path absolute."""
    own = tables.get("device")
    for keys in (("mass_kg",), ("range", "mass_kg")):
        node: Any = own
        for key in keys:
            node = node.get(key) if isinstance(node, Mapping) else None
        if node is not None:
            return ("device", *keys), f"is given; allowed: none, the {MASS} of an arm is that of its pose"
    worded = with_device({"device": own} if "device" in tables else {}, folder)
    if isinstance(worded, tuple):
        return worded
    if not worded.device.linear:
        return ("device", "motion"), 'is "rotary"; allowed: "linear", the device as it is felt at the tip of an arm'
    if worded.findings:
        return worded.findings[0]
    found: Mapping[str, Any] = {**tables, **worded.tables}
    device = found.get("device")
    if isinstance(device, Mapping):
        kept = {key: value for key, value in device.items() if key != "mass_kg"}
        if isinstance(kept.get("range"), Mapping):
            kept["range"] = {key: value for key, value in kept["range"].items() if key != "mass_kg"}
        found = {**found, "device": kept}
    model = found.get("model")
    if isinstance(model, Mapping) and isinstance(model.get("file"), str):
        found = {**found, "model": {**model, "file": str(Path(folder, model["file"]))}}
    return found


def _one_mechanism(values: Values) -> Iterator[Finding]:
    given = [name for name in MECHANISMS if values.given(name)]
    if len(given) != 1:
        tables = ", ".join(f"[{name}]" for name in MECHANISMS)
        yield (), f"has {' and '.join(f'[{one}]' for one in given) or 'no mechanism'}; allowed: exactly one of {tables}"


def _box(values: Values) -> Iterator[Finding]:
    low, high = values["workspace.low_m"], values["workspace.high_m"]
    if len(low) != len(high):
        message = f"has {len(high)} numbers; allowed: {len(low)}, as many as workspace.low_m"
        yield ("workspace", "high_m"), message
    elif any(one >= other for one, other in zip(low, high, strict=True)):
        yield (
            ("workspace", "high_m"),
            f"is {shown(high)}; allowed: each number above that of workspace.low_m",
        )


_RULES = (*DEVICE_RULES, _one_mechanism, _box)
