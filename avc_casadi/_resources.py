"""Location of the package's data: in a wheel, a checkout or an editable install."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def problems_folder() -> Path:
    """Return the folder of the catalogue; FileNotFoundError where the installation is damaged."""
    for folder in (_PACKAGE / "_problems", _PACKAGE.parent / "problems"):
        if (folder / "figure5.toml").is_file():
            return folder
    raise FileNotFoundError(f"the problem catalogue is missing beside {_PACKAGE}; reinstall avc-casadi")
