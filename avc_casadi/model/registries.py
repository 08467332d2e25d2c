"""What a problem file may name and rooms above declare: their folders are scanned when they are asked for."""

from __future__ import annotations

from typing import Any

from avc_casadi._util.registry import Registry

METHODS: Registry[Any] = Registry("method", "avc_casadi.design.method")
EFFECTS: Registry[Any] = Registry("effect", "avc_casadi.simulation.effects")
