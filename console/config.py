"""How a console is run."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})


@dataclass(frozen=True, slots=True)
class ConsoleConfig:
    """Where the console listens, and what it serves."""

    site_folder: Path
    data_folder: Path
    """Where the database lies."""
    host: str = "127.0.0.1"
    port: int = 8765
    """0 takes any free one."""
    tls_certificate: Path | None = None
    tls_key: Path | None = None
    insecure_listen: bool = False
    """Listen beyond this machine without TLS: passwords can be read on the way."""
    public_hosts: frozenset[str] = frozenset()
    """Names under which a proxy in front is reached."""

    @property
    def uses_tls(self) -> bool:
        """Whether this process itself speaks TLS."""
        return self.tls_certificate is not None

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can connect."""
        if self.host in LOOPBACK_NAMES:
            return True
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def allowed_hosts(self) -> frozenset[str] | None:
        """Host names that requests may be addressed to; None for any (it listens beyond this machine)."""
        return LOOPBACK_NAMES | {self.host} | self.public_hosts if self.is_loopback else None
