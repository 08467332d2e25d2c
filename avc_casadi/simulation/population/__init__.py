"""Populations of simulated hands: who they are, what they do, and whether they settle with a coupling."""
