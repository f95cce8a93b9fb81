"""Servers for whoever knows the token of their address; imports no library that takes long to load."""

from __future__ import annotations

import hmac
import secrets

import tornado.web

from viz.page.loopback import LocalRequestHandler, Loopback


class TokenServer(Loopback):
    """Server whose address has a token, which :class:`TokenHandler` requires of requests.

    Args:
        port: First port to try; a busy one is stepped over.
        token: Token of the address; a random one if None.

    Raises:
        SpaceRobotError: If no port is free.
    """

    def __init__(self, port: int, token: str | None = None) -> None:
        self.token = token or secrets.token_urlsafe(24)
        super().__init__(port)

    @property
    def url(self) -> str:
        """Address of the page, the token in it."""
        return f"{super().url}?token={self.token}"


class TokenHandler(LocalRequestHandler):
    """Handler that checks the token of requests."""

    def prepare(self) -> None:
        """Reject requests for another host name, or without the token."""
        super().prepare()
        token = self.get_query_argument("token", "")
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            raise tornado.web.HTTPError(403)
