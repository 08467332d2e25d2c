"""Faults of a device: why it gives no force, as codes on the wire and as sentences."""

from __future__ import annotations

from enum import IntFlag


class DeviceFault(IntFlag):
    """What a device has latched until it is cleared; HEARTBEAT alone ends by itself.

    Example:
        >>> [fault.word for fault in DeviceFault(5)]
        ['encoder jumped', 'too fast']
    """

    JUMP = 1
    STUCK = 2
    SPEED = 4
    ENERGY = 8
    NOT_FINITE = 16
    OVERRUN = 32
    DISABLED = 64
    WATCHDOG = 128
    BROWN_OUT = 256
    HEARTBEAT = 512
    ENCODER_REVERSED = 1024
    MOTOR_REVERSED = 2048
    MOTOR_DEAD = 4096

    @property
    def word(self) -> str:
        """Return it in a few words, several of them with commas."""
        return ", ".join(_WORDS[fault] for fault in type(self)(self))

    @property
    def advice(self) -> tuple[str, ...]:
        """Return what each of them means and what to look at, a sentence each."""
        return tuple(f"{_WORDS[fault]}: {_ADVICE[fault]}" for fault in type(self)(self))


_WORDS = {
    DeviceFault.JUMP: "encoder jumped",
    DeviceFault.STUCK: "encoder stuck",
    DeviceFault.SPEED: "too fast",
    DeviceFault.ENERGY: "too much energy",
    DeviceFault.NOT_FINITE: "force not a number",
    DeviceFault.OVERRUN: "ticks too long",
    DeviceFault.DISABLED: "enable line open",
    DeviceFault.WATCHDOG: "reset by the watchdog",
    DeviceFault.BROWN_OUT: "supply sank",
    DeviceFault.HEARTBEAT: "host silent",
    DeviceFault.ENCODER_REVERSED: "encoder reversed",
    DeviceFault.MOTOR_REVERSED: "motor reversed",
    DeviceFault.MOTOR_DEAD: "motor dead",
}
_ADVICE = {
    DeviceFault.JUMP: "between two ticks it moved as nothing of this mass can; look at its wires, shield and supply",
    DeviceFault.STUCK: "no count came though the force swung, or a hand was to move it; look at its wires, or for what "
    "blocks the device",
    DeviceFault.SPEED: "the device was faster than its limit; look for an unstable coupling, or a hand that let go",
    DeviceFault.ENERGY: "the coupling gave out more than it got; it does not hold this device (avc diagnose)",
    DeviceFault.NOT_FINITE: "the observer or the gains went beyond all bounds; push another coupling",
    DeviceFault.OVERRUN: "several in a row took longer than a sample time; a slower estimator or a longer sample time",
    DeviceFault.DISABLED: "the emergency stop, or what stands for it, is open; close it",
    DeviceFault.WATCHDOG: "the firmware hung and was started anew; push the coupling again",
    DeviceFault.BROWN_OUT: "the supply fell below its limit and the device started anew; push the coupling again",
    DeviceFault.HEARTBEAT: "no heartbeat in time; send them again, and let go of the device",
    DeviceFault.ENCODER_REVERSED: "it counts down on the way into the wall; swap its lines A and B, commission again",
    DeviceFault.MOTOR_REVERSED: "a force into the wall moved it out; swap the motor's two wires, then commission again",
    DeviceFault.MOTOR_DEAD: "a force moved it by no count; look at the amplifier's enable and supply, the motor's "
    "wires, and whether friction holds it (--force-n), then commission again",
}
WIRED_WRONGLY = DeviceFault.ENCODER_REVERSED | DeviceFault.MOTOR_REVERSED | DeviceFault.MOTOR_DEAD
"""What commissioning may find; with any of them a device takes no table."""
