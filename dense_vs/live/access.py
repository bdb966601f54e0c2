"""Who may use the page: this computer alone unless told otherwise, others with a token, and no other site's pages.

A browser sends another site's requests as readily as ours, so each request is asked where it comes from: ``Origin``
has to be the page's own, and on loopback ``Host`` has to name loopback, else a foreign name that resolves to 127.0.0.1
would count as our own origin.
"""

import hmac
import ipaddress
import secrets
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from dense_vs.checks import shown
from dense_vs.errors import DenseVSError

COOKIE = "dense_vs_live"
LEAST_TOKEN = 16  # characters


def is_loopback(host: str) -> bool:
    """Whether a host name or address is this computer's own."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def is_every_address(host: str) -> bool:
    """Whether a server at this host is reached at any address of the computer, as at 0.0.0.0."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_unspecified
    except ValueError:
        return False


class Access:
    """Judges requests by their headers.

    Args:
        host: that the server listens at.
        token: that a request has to bring; on loopback none is needed unless given, elsewhere one is made.

    Attributes:
        token: "" where none is needed.

    Raises:
        DenseVSError: no texts, or a token that is too short.
    """

    def __init__(self, host: str, token: str | None = None):
        for name, text in (("host", host), ("token", "" if token is None else token)):
            if not isinstance(text, str):
                raise DenseVSError(f"{name} is {shown(text)}; expected text")
        self._loopback = is_loopback(host)
        if token is not None and (len(token) < LEAST_TOKEN or not token.isascii() or not token.isalnum()):
            raise DenseVSError(
                f"the token has {len(token)} characters; expected {LEAST_TOKEN} letters and digits or more"
            )
        self.token = token if token is not None else "" if self._loopback else secrets.token_hex(16)

    def refusal(self, headers: Mapping[str, str], query: Mapping[str, str], *, changes: bool) -> str | None:
        """Why a request is refused; None where it may pass.

        Args:
            headers: of the request, names in lower case.
            query: of its address.
            changes: whether it is more than a look: a web socket or an upload, which have to name their origin.
        """
        host = headers.get("host", "")
        if self._loopback and not is_loopback(urlsplit(f"//{host}").hostname or ""):
            return "the page is served to this computer alone"
        origin = headers.get("origin")
        if origin is None:
            if changes:
                return "the request names no origin"
        elif urlsplit(origin).netloc != host or urlsplit(origin).scheme not in ("http", "https"):
            return "the request comes from another page"
        if self.token and not self._has_token(headers, query):
            return "the token is missing or wrong"
        return None

    def by_query(self, query: Mapping[str, str]) -> bool:
        """Whether the token stands in the address."""
        return bool(self.token) and hmac.compare_digest(query.get("token", "").encode(), self.token.encode())

    def _has_token(self, headers: Mapping[str, str], query: Mapping[str, str]) -> bool:
        if self.by_query(query):
            return True
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        return cookie is not None and hmac.compare_digest(cookie.value.encode(), self.token.encode())
