"""The sampled loop of a wall, an engine or a follower as maps from event to event, and what follows from them.

loop is the algebra of states and events; wall, engine and follower are the loops; system looks for their worst point
within ranges; spectrum, margins and walls (D-decomposition) say how they move.
"""
