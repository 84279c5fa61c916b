"""Server of a live run's page: two fixed paths, no files, and no input."""

import ipaddress
import socket
import socketserver
import sys
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from typing import Any
from urllib.parse import urlsplit

from estimation.live.window import Window
from estimation.output.report import render_page
from estimation.output.scene import page_colours


class WindowServer(socketserver.ThreadingTCPServer):
    """Serves a window in separate threads."""

    allow_reuse_address, daemon_threads = True, True
    most_browsers = 8

    def __init__(self, window: Window, title: str, host: str, port: int) -> None:
        """Start the server; port 0 chooses a free one.

        Raises:
            OSError: the address or the port is not available.
        """
        self.window, self.host = window, host
        self.page = render_page("window.html", {}, title=title, colours=page_colours()).encode()
        self.seats = threading.BoundedSemaphore(self.most_browsers)
        try:
            family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            self.address_family = family
            super().__init__((str(address[0]), port), _Handler)
        except (OSError, OverflowError) as error:
            raise OSError(
                f"the window cannot be served at {host}, port {port} ({error}): give another "
                "--window-host or --window-port"
            ) from error
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """Address of the page for browsers."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.server_address[1]}/"

    def close(self) -> None:
        """Stop the server, after a moment in which browsers receive the last event."""
        patience = 1.0  # time for all browsers [s]
        for _ in range(self.most_browsers):
            self.seats.acquire(timeout=patience / self.most_browsers)
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report an error, unless a browser has disconnected."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    timeout = 10.0  # for a browser that neither requests nor receives data [s]
    server_version, sys_version = "contactmodel", ""

    @property
    def _window(self) -> WindowServer:
        assert isinstance(self.server, WindowServer)
        return self.server

    def do_GET(self) -> None:
        """Send the page or its events."""
        if not is_own(self.headers.get("Host", ""), self._window.host):
            self.send_error(HTTPStatus.FORBIDDEN, "this page is served under another host name")
        elif self.path == "/":
            self._begin("text/html; charset=utf-8")
            self.wfile.write(self._window.page)
        elif self.path == "/events":
            self._send_events()
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Send an error; for all methods but GET, the same one."""
        if code == HTTPStatus.NOT_IMPLEMENTED:
            code, message = HTTPStatus.METHOD_NOT_ALLOWED, "only GET is served"
        super().send_error(code, message, explain)

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing on the terminal."""

    def _send_events(self) -> None:
        if not self._window.seats.acquire(blocking=False):
            self.send_error(HTTPStatus.SERVICE_UNAVAILABLE, "too many browsers show this run")
            return
        try:
            self._begin("text/event-stream")
            for line in self._window.window.follow():
                self.wfile.write(f"data: {line}\n\n".encode() if line else b":\n\n")
        finally:
            self._window.seats.release()

    def _begin(self, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        own = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"
        policy = f"{own}; img-src data:; connect-src 'self'; frame-ancestors 'none'"
        for name, value in {
            "Content-Type": kind,
            "Content-Security-Policy": policy,
            "Cache-Control": "no-store",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }.items():
            self.send_header(name, value)
        self.end_headers()


def is_own(host: str, served: str) -> bool:
    """Whether a request names this server by its address, not by a foreign host name.

    A foreign page could let its host name point to this machine and then read the data of this page
    (DNS rebinding). An address cannot be misused in this way.
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    if name in ("localhost", served.lower()):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
