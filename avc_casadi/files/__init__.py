"""Files: TOML problems and devices, the catalogue, gain and coupling documents."""
