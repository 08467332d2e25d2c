"""Simulation of a scene: only the effects that it lists, compiled into one CasADi step.

scene is one run; compile makes the step (tick) from effects/, contact and, between two samples, advance; execute runs
it, for many hands as C from emit; judge says whether it settles. population/ has the hands and their trials, runtime/
the steps of the control computer that firmware runs too, screen which effects a scene needs.
"""
