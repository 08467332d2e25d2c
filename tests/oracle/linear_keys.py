"""Keys of a device that slides, which no file of one that turns has."""

import re

LINEAR_KEY = re.compile(r"\b\w+_(?:kg|n|ns_per_m|n_per_m|m_per_s|m|m_per_n)\b")
LENGTHS = {"handle_radius_m", "capstan_radius_m"}


def linear_keys(text):
    return [key for key in LINEAR_KEY.findall(text) if key not in LENGTHS]
