"""The sampled loop of a law, an engine or a follower as maps from event to event, and what follows from them.

loop is the algebra of states and events. plant_family holds what a law must hold: devices and hands of ranges, their
corners, their worst case. wall closes a law around plants; engine and follower are loops of many patterns, families of
which stand in loop_family. search looks for the worst point of ranges; spectrum, margins and stable_walls
(D-decomposition) say how loops move.
"""
