"""Populations of simulated hands: parameters, motions, and whether they settle with a coupling."""
