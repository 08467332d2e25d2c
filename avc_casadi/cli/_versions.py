"""Versions of the packages behind a result."""

from __future__ import annotations

import platform

import avc_casadi as avc

_PACKAGES = ("casadi", "numpy", "matplotlib", "pydantic", "pyserial", "unicorn")


def package_versions() -> dict[str, str]:
    """Return the version of this package, of Python and of every dependency; "absent" where not installed."""
    return {"avc-casadi": avc.__version__, "Python": platform.python_version()} | {
        name: _version(name) for name in _PACKAGES
    }


def _version(package: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
