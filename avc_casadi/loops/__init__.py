"""The sampled loop of a wall, an engine or a follower as maps from event to event, and what follows from them."""
