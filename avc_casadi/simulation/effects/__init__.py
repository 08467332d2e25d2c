"""The effects of a scene, by their station in the loop, and their registry."""
