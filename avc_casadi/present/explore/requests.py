"""A request that the page would not make: refused with a status of HTTP, and nothing else happens."""

from __future__ import annotations

from avc_casadi._errors import AvcError


class RequestError(AvcError):
    """What is wrong with a request."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status
