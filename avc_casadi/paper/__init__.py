"""The paper: its equations once for every number system, its errata, closed form, direct NLP and exact optimum."""
