"""English of certificates: what a level claims and finds, what a pair and a port are certified for."""

from __future__ import annotations

from avc_casadi._util.units import Units
from avc_casadi.claims.engine_port import PortPassivity
from avc_casadi.design.pair_certificate import PairCertificate
from avc_casadi.design.virtual_tool import PairFault
from avc_casadi.recommendation.recommendation import LimitCycleFreedom


def limit_cycle_clauses(freedom: LimitCycleFreedom, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return the claim of rest with every hand, or why none was tried."""
    if freedom.proof is None:
        return ("not attempted", "avc recommend P --prove tries it, which takes minutes")
    return (freedom.proof.claim, *(("for the wall alone, without [detent]",) if freedom.without_detents else ()))


def pair_clauses(certificate: PairCertificate, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what the certificate of a pair claims."""
    claim = (
        "linear stability of the lifted loop: hands of [hands] and the device released, devices, tools, delays, steady "
        "steps and contacts of their ranges (corners, then a search for the worst point inside), every phase of the "
        "clocks (one where a step is a whole number of samples: it begins at a sample)"
    )
    return (claim,)


def port_clauses(passivity: PortPassivity, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what passivity at the engine's port claims."""
    claim = (
        "the port between engine and coupling is passive, with the extreme hands of [hands] and released: stable with "
        "any engine that is passive at this port, for any mass and contact of its tool. An engine is passive if it "
        "solves the tool together with the coupling's force (implicit); an engine that moves a mass explicitly is not"
    )
    return (claim,)


def pair_fault_clauses(fault: PairFault, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return why a pair should not run on a device."""
    if fault.least_gain_margin is None:
        return ("linearly unstable",)
    return (f"linearly stable with a gain margin below {fault.least_gain_margin:g}, of K and B or of one motor alone",)
