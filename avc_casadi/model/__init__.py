"""The problem as plain data, and the registries of the names in it that later packages fill."""

from __future__ import annotations

from typing import Any

from avc_casadi._util.registry import Registry

METHODS: Registry[Any] = Registry("method", "avc_casadi.design.registry")
EFFECTS: Registry[Any] = Registry("effect", "avc_casadi.simulation.effects")
