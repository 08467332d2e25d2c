"""Passivity of the sampled loop: worst frequency, worst port, Llewellyn."""
