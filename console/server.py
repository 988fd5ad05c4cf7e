"""Running the console: one process, one port, one origin."""

from __future__ import annotations

import errno
import json
import os
import signal
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType

import uvicorn
from fastapi import FastAPI

from console.app import app_of
from console.config import ConsoleConfig
from console.http_patience import CountingSocket, PatientHttp, PatientLoop
from console.opening import let_token_of_file_in, open_services
from console.security import visitor_of
from console.services import Services
from navcore.errors import InputError
from navcore.wire import MAX_MESSAGE_BYTES

WS_MAX_BYTES = MAX_MESSAGE_BYTES + (1 << 10)
"""What comes in on a socket is a message of a device at most; one that is a little too large is told why."""


@dataclass(frozen=True, slots=True)
class Ready:
    """What a console that takes requests says of itself."""

    url: str
    first_link: str | None
    """One-time link with which the first admin chooses a password; None where there is an admin already."""
    warning: str | None = None
    """What is wrong, and what to do, though it serves."""

    def write(self, path: Path) -> None:
        """Write it as JSON, in one step, for the owner's eyes only: the link is a key."""
        fresh = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as out:
                json.dump({**asdict(self), "pid": os.getpid()}, out)
            os.replace(fresh, path)
        except OSError as error:
            fresh.unlink(missing_ok=True)
            raise InputError(f"The ready file {path} cannot be written ({error.strerror}): name another.") from error


class ConsoleServer:
    """A console on its socket, with site, database and (unless left out) the 3D scene.

    :meth:`run` serves until :meth:`stop` or a signal; :meth:`start` does so in a thread, and returns when it is ready.
    """

    def __init__(
        self, config: ConsoleConfig, *, device_token_file: Path | None = None, with_scene: bool = True
    ) -> None:
        check_listening(config)
        self._socket = _bind(config)
        try:
            self.services: Services = open_services(config)
            warning = None
            if device_token_file is not None:
                warning = let_token_of_file_in(self.services.devices, device_token_file)
            self.app: FastAPI = app_of(self.services)
            self._stop_scene = _install_scene(self.app, self.services) if with_scene else _nothing
        except BaseException:
            self._socket.close()
            raise
        self.ready = self._ready(config, warning)
        self._uvicorn = _Uvicorn(self.app, config)
        self._thread: threading.Thread | None = None

    def run(self, on_ready: Callable[[Ready], None] = lambda _: None) -> None:
        """Serve until stopped; ``on_ready`` is called once requests are taken. Must be the main thread for signals."""
        self._uvicorn.on_started = lambda: on_ready(self.ready)
        self.services.alerts.start()
        for timer in self.services.timers:
            timer.start()
        try:
            self._uvicorn.run(sockets=[self._socket])
        finally:
            self._stop_scene()
            self._socket.close()
            self.services.alerts.close()
            for timer in self.services.timers:
                timer.close()
            self.services.late_audit.write()
            self.services.builds.close()
            self.services.what_ifs.close()
            self.services.surveys.close()
            self.services.checks.close()
            self.services.store.close()

    def start(self) -> Ready:
        """Serve in a thread of its own; return when requests are taken. Raises InputError where that fails."""
        started = threading.Event()

        def serve() -> None:
            try:
                self.run(lambda _: started.set())
            finally:
                started.set()

        self._thread = threading.Thread(target=serve, name="console", daemon=True)
        self._thread.start()
        started.wait()
        if not self._uvicorn.started:
            raise InputError("The console could not start: see the log above.")
        return self.ready

    def stop(self) -> None:
        """Stop serving; returns when everything is closed where :meth:`start` was used."""
        self._uvicorn.should_exit = True
        if self._thread is not None:
            self._thread.join()

    def _ready(self, config: ConsoleConfig, warning: str | None) -> Ready:
        scheme = "https" if config.uses_tls else "http"
        host = f"[{config.host}]" if ":" in config.host else config.host
        url = f"{scheme}://{host}:{self._socket.getsockname()[1]}"
        token = self.services.accounts.first_admin_link_token()
        return Ready(url, f"{url}/first?token={token}" if token else None, warning)


def check_listening(config: ConsoleConfig) -> None:
    """Raise InputError where passwords would go over the network in the clear, or TLS is set up by halves."""
    if (config.tls_certificate is None) != (config.tls_key is None):
        raise InputError("TLS needs both files: give --tls-cert and --tls-key.")
    for path in (config.tls_certificate, config.tls_key):
        if path is not None and not path.is_file():
            raise InputError(f"There is no TLS file {path}: name an existing one.")
    if config.tls_certificate is not None and config.tls_key is not None:
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(config.tls_certificate, config.tls_key)
        except (OSError, ssl.SSLError) as error:
            raise InputError(
                f"{config.tls_certificate} and {config.tls_key} are no certificate and its key ({error}): name the two"
                " PEM files that belong together."
            ) from error
    if not (config.is_loopback or config.uses_tls or config.insecure_listen):
        raise InputError(
            f"Listening on {config.host} without TLS would send passwords in the clear: give --tls-cert and --tls-key,"
            " or say --insecure-listen if the network is yours alone."
        )


def _bind(config: ConsoleConfig) -> socket.socket:
    family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
    listening = CountingSocket(family)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((config.host, config.port))
    except (OSError, OverflowError) as error:
        listening.close()
        if getattr(error, "errno", None) == errno.EADDRINUSE:
            raise InputError(
                f"Port {config.port} of {config.host} is taken: stop what uses it, or choose another with --port (0"
                " takes any free one)."
            ) from error
        raise InputError(
            f"The console cannot listen on {config.host} port {config.port} ({error}): choose others with --host and"
            " --port."
        ) from error
    return listening


def _install_scene(app: FastAPI, services: Services) -> Callable[[], None]:
    # Here, since it brings viser, which the commands that need no scene should not wait for.
    from console.viewer.scene import install

    return install(app, services, visitor_of).stop


def _nothing() -> None:
    """There is no scene to stop."""


class _Uvicorn(uvicorn.Server):
    def __init__(self, app: FastAPI, config: ConsoleConfig) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                http=PatientHttp,
                loop=f"{PatientLoop.__module__}:{PatientLoop.__qualname__}",
                log_level="warning",
                access_log=False,
                # Who connects is who sends, unless a proxy in front was declared: that one is on this machine.
                proxy_headers=bool(config.public_hosts),
                forwarded_allow_ips=["127.0.0.1", "::1"],
                server_header=False,
                ws_per_message_deflate=False,
                ws_max_size=WS_MAX_BYTES,
                # A large map on a slow link holds the ping back: it must not be taken for a dead link.
                ws_ping_interval=20.0,
                ws_ping_timeout=120.0,
                timeout_graceful_shutdown=3,
                ssl_certfile=config.tls_certificate,
                ssl_keyfile=config.tls_key,
            )
        )
        self.on_started: Callable[[], None] = _nothing

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End in good order; a second Ctrl-C, which uvicorn would take for haste, changes nothing."""
        self.should_exit = True

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop on SIGINT and SIGTERM, and let that be a good end: uvicorn's own would raise them once more."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self.handle_exit) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to take requests, and say so."""
        await super().startup(sockets)
        if self.started:
            self.on_started()
