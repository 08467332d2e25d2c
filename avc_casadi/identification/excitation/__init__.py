"""Excitation signals for identification, played within limits."""
