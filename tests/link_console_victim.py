"""A console process that is there to be killed: ``SITE DATA PORT TOKEN_FILE HOST``; says its address, and the one-time
link of a first start (or an empty line), once it serves.
"""

from __future__ import annotations

import sys
from pathlib import Path

from console.config import ConsoleConfig
from console.server import ConsoleServer, Ready


def main() -> None:
    """Serve until killed."""
    site, data, port, token_file, host = sys.argv[1:]
    server = ConsoleServer(
        ConsoleConfig(Path(site), Path(data), host, int(port), insecure_listen=True),
        device_token_file=Path(token_file), with_scene=False,
    )  # fmt: skip

    def say(ready: Ready) -> None:
        sys.stdout.write(f"{ready.url}\n{ready.first_link or ''}\n")
        sys.stdout.flush()

    server.run(say)


if __name__ == "__main__":
    main()
