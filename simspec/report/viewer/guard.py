"""A viser server for one user of this machine: on the loopback address alone, and nothing is sent without a token.

viser has no hook for requests, so the function that starts its server is replaced while it is started: every request, of pages
and of websockets, is checked before viser sees it. A server that did not start through that function is stopped at once.
"""

from __future__ import annotations

import contextlib
import hmac
import importlib
import io
import logging
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any, Final

from simspec.errors import Problem, SpecError

LOOPBACK: Final = "127.0.0.1"
HOST_NAMES: Final = (LOOPBACK, "localhost")
"""Names of this machine that a browser may use. Any other is the name of a web site that leads to this address."""
TOKEN_BYTES: Final = 24
FORBIDDEN: Final = 403
_starting = threading.Lock()

HEADERS: Final = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
}
POLICY: Final = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; "
    "connect-src data: blob: http://{host} ws://{host}; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""The page's content security policy: it loads from this server alone. Its program is one file with inline scripts."""


def port_problem(port: int) -> Problem | None:
    """Why no server can be started on ``port`` of this machine; None where one can."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError as error:
            hint = "leave --port out, for any free port"
            return Problem(f"--port {port}: {(error.strerror or str(error)).lower()}", hint=hint, code="C118")
    return None


class Guard:
    """The rule for requests: the token is in the path, and the address is one of this machine."""

    def __init__(self, token: str | None = None):
        self.token = secrets.token_urlsafe(TOKEN_BYTES) if token is None else token

    def inner_path(self, path: str) -> str | None:
        """The path below the token; None where the token is not the first part of ``path``."""
        place, question, query = path.partition("?")
        given, _, rest = place.removeprefix("/").partition("/")
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self.token.encode()):
            return None
        return f"/{rest}{question}{query}"

    def refuses(self, path: str, hosts: list[str], origins: list[str]) -> bool:
        """Whether a request is refused. ``hosts``, ``origins``: its headers of these names; a browser sends the origin of
        the page that a websocket is of, and the address that the user went to as the host."""
        if len(hosts) != 1 or hosts[0].partition(":")[0] not in HOST_NAMES:
            return True
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return True
        return self.inner_path(path) is None

    def checked(self, process: Callable[..., Any]) -> Callable[..., Any]:
        """``process``, which answers requests for pages and passes those for websockets on (None), for allowed requests."""

        def request(connection: Any, received: Any) -> Any:
            headers = received.headers
            hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
            if self.refuses(received.path, hosts, origins):
                return connection.respond(FORBIDDEN, "")
            received.path = self.inner_path(received.path)
            response = process(connection, received)
            if response is not None:
                for name, value in {**HEADERS, "Content-Security-Policy": POLICY.format(host=hosts[0])}.items():
                    response.headers[name] = value
            return response

        return request


@contextlib.contextmanager
def serving(port: int, title: str) -> Iterator[tuple[Any, str]]:
    """A viser server on the loopback address, and the address of its page, which has the token in it. ``port`` 0: any free one.

    Raises SpecError where the port cannot be used, and ModuleNotFoundError without viser.
    """
    import viser

    guard = Guard()
    if (problem := port_problem(port)) is not None:
        raise SpecError([problem])
    server = _started(viser.ViserServer, guard, port, title)
    try:
        if port not in (0, server.get_port()):  # viser takes the next port where another program was faster
            raise SpecError([Problem(f"--port {port}: address already in use", hint="leave --port out", code="C118")])
        yield server, f"http://{LOOPBACK}:{server.get_port()}/{guard.token}/"
    finally:
        with contextlib.redirect_stdout(io.StringIO()):  # viser says that it has stopped
            server.stop()


def _started(kind: Any, guard: Guard, port: int, title: str) -> Any:
    """A server of viser's whose every request goes through ``guard``; without viser's way to share it on the internet."""
    sockets: Any = importlib.import_module("websockets.asyncio.server")
    # never: a shared address leads from the internet to this machine, and a page can request it
    guarded_kind = type("GuardedServer", (kind,), {"request_share_url": lambda self, verbose=True: None})
    start, guarded = sockets.serve, []
    quiet = logging.getLogger("simspec.viewer")
    quiet.addHandler(logging.NullHandler())
    quiet.propagate = False

    def serve(*words: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        guarded.append(True)
        return start(*words, process_request=guard.checked(process_request), **{**options, "logger": quiet})

    with _starting, contextlib.redirect_stdout(io.StringIO()):  # viser prints a box
        sockets.serve = serve
        try:
            server = guarded_kind(host=LOOPBACK, port=port, label=title, verbose=False)
        finally:
            sockets.serve = start
        if not guarded:
            server.stop()
            raise RuntimeError("this version of viser starts its server in another way: it cannot be guarded")
    return server
