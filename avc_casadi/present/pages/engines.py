"""Couplings to a simulation in the parameters of each engine, and their pitfalls there."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

from avc_casadi._util.units import FORCE, FORCES, KG, M_PER_S, MASS, MM, MM_PER_S, N_PER_M, NEWTON, NS_PER_M
from avc_casadi.model.mujoco_constraint import SOFT_IMPEDANCE, MujocoConstraint
from avc_casadi.model.virtual_tool import ToolIntegrator

if TYPE_CHECKING:
    from avc_casadi.other_end_coupling import ToolCoupling

# Loads at which a contact stiffness is given in N/m: a light touch and a press.
_LOADS_N = (0.2, 2.0)
_OWN_VELOCITY = "take the difference of two positions, as avc_coupling_step does"


@dataclass(frozen=True)
class Parameter:
    """One parameter of an engine.

    Attributes:
        name: in the engine.
        value: a number, or text.
        unit: of the engine; empty for none.
        where: place of the setting.
    """

    name: str
    value: float | str
    unit: str
    where: str


@dataclass(frozen=True)
class Said:
    """A coupling in the parameters of an engine.

    Attributes:
        parameters: settings of the engine.
        lines: code of each step.
        instead: workarounds where the engine has no setting.
        traps: pitfalls of the engine.
    """

    parameters: tuple[Parameter, ...]
    lines: tuple[str, ...]
    instead: tuple[str, ...]
    traps: tuple[str, ...]


@dataclass(frozen=True)
class Engine:
    """A simulation engine.

    Attributes:
        title: its name.
        step: the call of its time step.
        integrators: its names of the integrators; empty where unknown.
        say: expresses a coupling in its parameters.
        turns: whether it supports a rotary device.
    """

    title: str
    step: str
    integrators: dict[ToolIntegrator, str]
    say: Callable[[ToolCoupling], Said]
    turns: bool = True


def number_text(value: float | str) -> str:
    """Return a number to six digits, never with an exponent, which a settings page may refuse; text unchanged."""
    if isinstance(value, str) or value == 0:
        return str(value) if isinstance(value, str) else "0"
    text = f"{value:.{max(0, 5 - math.floor(math.log10(abs(value))))}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _span(low: float, high: float) -> float | str:
    return low if low == high else f"{number_text(low)} to {number_text(high)}"


def _mass(coupling: ToolCoupling, name: str, where: str) -> tuple[Parameter, ...]:
    mass = coupling.tool.tool_mass_kg
    return () if mass is None else (Parameter(name, _span(*mass), "kg", where),)


def _step(coupling: ToolCoupling, name: str, where: str) -> Parameter:
    return Parameter(name, _span(*coupling.tool.step_s), "s", where)


def _gains(coupling: ToolCoupling) -> tuple[float, float]:
    """Return K and B in the units of the engine."""
    return coupling.in_scene.stiffness_n_per_m, coupling.in_scene.damping_ns_per_m


def _device(coupling: ToolCoupling, loop: str) -> str:
    """Return the call that applies the force to the device."""
    what = f"{FORCE} on the tool" if coupling.tool.exchange == "held-force" else "tool_x, tool_v"
    if coupling.tool.exchange == "held-force" and coupling.tool.solved != "nothing":
        what = "avc_coupling_handed_force(...)"
    every = number_text(1e3 * coupling.problem.device.sample_time_s)
    return f"F = avc_coupling_step(&c, x, {what}) in {loop}, every {every} ms"


def _seen(coupling: ToolCoupling) -> tuple[str, str]:
    """Return position and velocity of the device in the scene, as code."""
    scale = coupling.tool.position_scale
    return ("x", "v") if scale == 1 else (f"{number_text(scale)}*x", f"{number_text(scale)}*v")


def _mujoco(coupling: ToolCoupling) -> Said:
    (k, b), tool, (x, v) = _gains(coupling), coupling.tool, _seen(coupling)
    parameters: tuple[Parameter, ...] = (
        _step(coupling, "timestep", "<option timestep=.../>"),
        Parameter("integrator", ENGINES["mujoco"].integrators.get(tool.integrator, "Euler"), "", "<option .../>"),
        *_mass(coupling, "mass", "of the tool, in its geoms or <inertial .../>"),
    )
    damper = f"{number_text(b)}*({v} - data.qvel[dof])"
    if tool.solved == "damper":
        # The integrator treats only the damper of a joint implicitly.
        parameters += (Parameter("damping", b, "N.s/m", "<joint damping=.../> of the tool: B, seen by implicitfast"),)
        damper = f"{number_text(b)}*{v}"
    law = f"data.qfrc_applied[dof] = {number_text(k)}*({x} - data.qpos[dof]) + {damper}"
    instead = (
        "the C of avc export --c has the line in avc_coupling_tool_force, without what the joint has: one of the two",
    )
    traps: tuple[str, ...] = ("x and v are the newest sample of the device and its backward difference, not filtered",)
    if tool.tool_mass_kg is not None and coupling.problem.units.linear:
        parameters += _mujoco_constraints(k, b, tool.tool_mass_kg)
        lag = number_text(1e3 * b / k) if k else "0"
        traps += (
            (
                "a weld grows with the tool: solref is -K (1 - d)/m, -B (1 - d)/m, d of solimp, m 1/body_invweight0; d "
                f"as MuJoCo has it, 0.9 to 0.95, makes the tool 10 to 20 times heavier towards other {FORCES}"
            ),
            (
                "a mocap body has no velocity for MuJoCo: the weld's damper brakes the tool towards the ground, by "
                f"{lag} {MM} for each {M_PER_S}; qfrc_applied does not"
            ),
            f"a contact grows with the {MASS} of the tool too: give it solref and solimp of its own",
        )
    return Said(parameters, (_device(coupling, "the device's loop"), law, "mj_step(model, data)"), instead, traps)


def _mujoco_constraints(k: float, b: float, masses: tuple[float, float]) -> tuple[Parameter, ...]:
    """Return the weld that is the coupling, and MuJoCo's own contact in N/m."""
    weld, contact = MujocoConstraint.of(k, b, masses[0]), MujocoConstraint()
    which = "<weld> or <connect> of the tool to a mocap body"
    if masses[0] != masses[1]:
        which += f", for {number_text(masses[0])} {KG}"
    solref = " ".join(map(number_text, weld.solref))
    contacts = tuple(
        Parameter(
            "default contact",
            _span(*(contact.stiffness_n_per_m(mass, load) for mass in masses)),
            "N/m",
            f"what the tool meets under {number_text(load)} {NEWTON}, with MuJoCo's own solref and solimp",
        )
        for load in _LOADS_N
    )
    return (
        Parameter("solref", solref, "", which),
        Parameter("solimp", f"{SOFT_IMPEDANCE:g} {SOFT_IMPEDANCE:g} 0.001", "", "the same"),
        *contacts,
    )


def _chai3d(coupling: ToolCoupling) -> Said:
    tool = coupling.tool
    surface = coupling.gains.stiffness_n_per_m / tool.position_scale
    return Said(
        (
            Parameter("setStiffness", surface, "N/m", "m_material of what is touched, for each metre of the scene"),
            Parameter("workspace scale", tool.position_scale, "", "tool->getWorkspaceScaleFactor() must be this"),
            *_mass(coupling, "mass", f"of a dynamic tool (Bullet, ODE); that of the examples weighs 0.01 {KG}"),
            _step(coupling, "time step", "updateDynamics(...)"),
        ),
        (_device(coupling, "the haptic thread"), "device->setForce(F), times the direction"),
        (
            f"cToolCursor's proxy is a bare spring without a place for B: leave its {FORCE} out, and set F",
            "in the Bullet example K is linStiffness times linGain times the workspace scale, and there is no damper",
        ),
        (
            f"getLinearVelocity looks back over 15 ms, half of that late: {_OWN_VELOCITY}",
            "the haptic thread runs as fast as it can: pace it to the sample time",
        ),
    )


def _unity(coupling: ToolCoupling) -> Said:
    k, b = _gains(coupling)
    linear = coupling.problem.units.linear
    drive = "xDrive, yDrive, zDrive" if linear else "angularXDrive"
    add = "AddForce" if linear else "AddTorque"
    others = (
        f"the spring of the OpenHaptics plugin, 0 to 1, is a share of what the device is rated for, no {N_PER_M}",
        f"that of Haply's tutorial is in {N_PER_M}, 0 to 800, with a damper of 0 to 3 {NS_PER_M}",
    )
    body = "Rigidbody.mass of the tool, its drag 0" if linear else "Rigidbody.inertiaTensor of the tool, its drag 0"
    return Said(
        (
            _step(coupling, "Fixed Timestep", "Project Settings > Time, or Time.fixedDeltaTime"),
            *_mass(coupling, "mass" if linear else "inertia", body),
            Parameter("positionSpring", k, "N/m", f"JointDrive of a ConfigurableJoint: {drive}"),
            Parameter("positionDamper", b, "N.s/m", "the same"),
            Parameter("useAcceleration", "false", "", f"the same: with true both would be of a unit of {MASS}"),
        ),
        (
            _device(coupling, "a thread of its own"),
            f"body.{add}(avc_coupling_tool_force(&c, place, velocity) times the direction) in FixedUpdate",
        ),
        (),
        (
            (
                f"what is certified is {add} in FixedUpdate: a drive is solved with the contacts, and its damper "
                "brakes towards targetVelocity, which is 0 unless you set it to that of the device"
            ),
            "after a slow frame several FixedUpdate come at once: say the longest gap as the upper end of step_s",
            "an interpolated transform is for the eye: read Rigidbody.position in FixedUpdate",
            *(others if linear else ()),
        ),
    )


def _sofa(coupling: ToolCoupling) -> Said:
    k, b = _gains(coupling)
    lines: tuple[str, ...] = (
        _device(coupling, "the haptic thread"),
        "tool_x, tool_v: MechanicalObject of the tool at AnimateBeginEvent",
    )
    if coupling.tool.solved == "spring and damper":
        lines += ("share = avc_coupling_target(&c, &place, &velocity) before the step: place is the spring's rest",)
    return Said(
        (
            _step(coupling, "dt", "of the root node"),
            *_mass(coupling, "totalMass", "UniformMass of the tool"),
            Parameter("stiffness", k, "N/m", "RestShapeSpringsForceField from the tool to the device's state"),
            # Of one spring this is -B v at the end of the step, as the certified integrator has it.
            Parameter("rayleighStiffness", b / k if k else 0.0, "s", "EulerImplicitSolver of the tool alone: B/K"),
            Parameter("rayleighMass", 0.0, "", "the same"),
            Parameter("forceCoef", coupling.tool.force_scale, "", "of the ForceFeedback component; 0.03 by default"),
        ),
        lines,
        (
            (
                f"RestShapeSpringsForceField has no damper: rayleighStiffness is that of the tool, and a "
                f"ConstantForceField of {number_text(b)} {NS_PER_M} times the velocity of the device adds the rest"
            ),
        ),
        (
            (
                "kd of SpringForceField and JointSpringForceField, and a damper in a ConstantForceField, are explicit: "
                "another loop, in which a light tool is unstable"
            ),
            f"forceCoef scales the {FORCE} alone: with 0.03 the device feels 0.03 of K",
            (
                f"SOFA has no units: in centimetres, kilograms and seconds a {FORCE} of 1 is 0.01 {NEWTON}; say "
                "position_scale = 100 and force_scale = 0.01 in [simulation]"
            ),
            "LCPForceFeedback solves the contacts again in the haptic thread: another loop than this one",
        ),
    )


def _openhaptics(coupling: ToolCoupling) -> Said:
    gains, device = coupling.gains, coupling.problem.device
    return Said(
        (
            Parameter("K", gains.stiffness_n_per_m / 1e3, "N/mm", "at most hdGetDoublev(HD_NOMINAL_MAX_STIFFNESS)"),
            Parameter("B", gains.damping_ns_per_m / 1e3, "N.s/mm", "at most hdGetDoublev(HD_NOMINAL_MAX_DAMPING)"),
            Parameter("rate", 1 / device.sample_time_s, "Hz", "hdSetSchedulerRate(...)"),
        ),
        (
            _device(coupling, "the servo callback"),
            f"hdSetDoublev(HD_CURRENT_FORCE, ...): F times the direction, in {NEWTON}",
        ),
        (
            "HDAPI has no coupling: call avc_coupling_step in the callback of hdScheduleAsynchronous",
            (
                "HLAPI takes HL_STIFFNESS and HL_DAMPING from 0 to 1, shares of what the device is rated for; its "
                "proxy is not this tool, and nothing is certified of it"
            ),
        ),
        (
            f"HD_CURRENT_POSITION is in {MM}: x is a thousandth of it",
            f"HD_CURRENT_VELOCITY is smoothed, and in {MM_PER_S}: {_OWN_VELOCITY}",
            "a stiffness that the device is rated for is no proof that K up to it is stable",
        ),
    )


def _imstk(coupling: ToolCoupling) -> Said:
    (k, b), tool = _gains(coupling), coupling.tool
    linear = coupling.problem.units.linear
    critical = ""
    if tool.tool_mass_kg is not None:
        critical = f", here {number_text(2 * math.sqrt(k * min(tool.tool_mass_kg)))} {NS_PER_M}"
    traps: tuple[str, ...] = (
        f"setUseCritDamping(true) takes 2 sqrt(Ks m) for Kd{critical}",
        (
            f"setUseForceSmoothening(true) hands out the mean of setSmoothingKernelSize {FORCES}, usually 10 to 30: a "
            "delay"
        ),
    )
    if tool.exchange != "held-force":
        traps += (
            (
                f"the controller hands out a {FORCE}, and the device holds it: say exchange = held-force in "
                "[simulation] and make it again, or do without the controller"
            ),
        )
    return Said(
        (
            *_mass(coupling, "mass", "of the tool's body"),
            _step(coupling, "dt", "of the scene"),
            Parameter("setLinearKs" if linear else "setAngularKs", k, "N/m", "of the tool's object controller"),
            Parameter("setLinearKd" if linear else "setAngularKd", b, "N.s/m", "the same"),
            Parameter("setUseCritDamping", "false", "", "the same"),
            Parameter("setTranslationScaling", tool.position_scale, "", "the same"),
            Parameter("setForceScaling", tool.force_scale, "", "the same"),
            Parameter("setUseForceSmoothening", "false", "", "the same"),
        ),
        (_device(coupling, "the device's own thread"),),
        (
            (
                "Kd brakes the tool's own velocity, and leaves the device's out: another loop than this one. Put "
                "avc_coupling_tool_force on the body before each step in place of the controller"
            ),
        ),
        traps,
    )


def _ros2(coupling: ToolCoupling) -> Said:
    (k, b), masses = _gains(coupling), coupling.tool.tool_mass_kg
    instead: tuple[str, ...] = (
        (
            f"admittance_controller takes a {FORCE} and gives a position: the robot is the tool, the device its "
            "reference, and avc_coupling_step is the device's own end"
        ),
    )
    ratio: tuple[Parameter, ...] = ()
    if masses is None or k == 0:
        instead += (
            f"damping_ratio is told of {MASS} and stiffness, and this coupling has not both: choose them for B",
        )
    else:
        value = b / (2 * math.sqrt(k * min(masses)))
        ratio = (Parameter("damping_ratio", value, "", "admittance.damping_ratio of the axis: B/(2 sqrt(m K))"),)
    return Said(
        (
            *_mass(coupling, "mass", "admittance.mass of the axis"),
            Parameter("stiffness", k, "N/m", "admittance.stiffness of the axis"),
            *ratio,
            Parameter("selected_axes", "true", "", "admittance.selected_axes of the axis"),
            _step(coupling, "period", "1/update_rate of the controller_manager"),
            Parameter("filter_coefficient", 1.0, "", "ft_sensor.filter_coefficient: 1 is no filter"),
        ),
        (_device(coupling, "the device's loop"),),
        instead,
        (
            f"B is damping_ratio 2 sqrt({MASS} stiffness): it changes with both of them",
            "ft_sensor.filter_coefficient is 0.05 by default: a low-pass over some 20 periods, which no one declared",
        ),
    )


def _pybullet(coupling: ToolCoupling) -> Said:
    (k, b), (x, v) = _gains(coupling), _seen(coupling)
    add = "applyExternalForce(tool, -1, f, place, p.WORLD_FRAME)"
    if not coupling.problem.units.linear:
        add = "applyExternalTorque(tool, -1, f, p.WORLD_FRAME)"
    return Said(
        (
            _step(coupling, "setTimeStep", "p.setTimeStep(...), numSubSteps 0"),
            *_mass(coupling, "baseMass", "p.createMultiBody(baseMass=...)"),
            Parameter("linearDamping", 0.0, "", "p.changeDynamics(tool, -1, linearDamping=0); 0.04 by default"),
            Parameter("K", k, "N/m", "in the line below"),
            Parameter("B", b, "N.s/m", "in the line below"),
        ),
        (
            _device(coupling, "the device's loop"),
            f"f = {number_text(k)}*({x} - tool_x) + {number_text(b)}*({v} - tool_v), times the direction",
            f"p.{add}; p.stepSimulation()",
        ),
        (f"createConstraint takes maxForce, and its softness is no {N_PER_M}: leave it out, and apply the {FORCE}",),
        (
            f"an applied {FORCE} is forgotten after each stepSimulation, and setRealTimeSimulation(1) takes none",
            "stepSimulation does not wait: pace it to the step by a clock",
        ),
    )


_SEMI_IMPLICIT: dict[ToolIntegrator, str] = {"semi-implicit": "semi-implicit"}
_ANY: dict[ToolIntegrator, str] = {one: one for one in get_args(ToolIntegrator)}
ENGINES: dict[str, Engine] = {
    "mujoco": Engine("MuJoCo", "mj_step", {"semi-implicit": "Euler", "implicit-damping": "implicitfast"}, _mujoco),
    "chai3d": Engine("CHAI3D", "updateDynamics", _SEMI_IMPLICIT, _chai3d, turns=False),
    "unity": Engine("Unity (PhysX)", "the physics step", _SEMI_IMPLICIT, _unity),
    "sofa": Engine("SOFA", "animate", {"implicit": "EulerImplicitSolver"}, _sofa, turns=False),
    "openhaptics": Engine("OpenHaptics", "your engine's step", _ANY, _openhaptics, turns=False),
    "imstk": Engine("iMSTK", "the scene's step", {}, _imstk),
    "ros2": Engine("ROS 2", "the admittance_controller's update", _SEMI_IMPLICIT, _ros2),
    "pybullet": Engine("PyBullet", "stepSimulation", _SEMI_IMPLICIT, _pybullet),
}
"""Engines in whose parameters a coupling can be expressed."""
