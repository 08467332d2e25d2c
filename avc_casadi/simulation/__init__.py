"""Simulation of a scene: only the effects that it lists, compiled into one CasADi step."""
