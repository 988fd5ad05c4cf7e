"""Two network namespaces joined by a line that loses, delays, reorders, throttles and cuts packets.

The line is a thread between two TUN devices, for many kernels have no netem. All addresses are inside the two
namespaces that are made here; nothing else of the machine is touched, and nothing can be reached from them.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import heapq
import itertools
import os
import random
import select
import shutil
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

CONSOLE_IP, DEVICE_IP, OTHER_DEVICE_IP = "10.213.0.2", "10.213.0.1", "10.213.0.3"
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_CLONE_NEWNET = 0x40000000
_PACKET_BYTES = 2048
_LONGEST_QUEUE_S = 1.0


@dataclass
class Way:
    """How one direction of the line is just now."""

    loss: float = 0.0
    """Share of packets that are lost."""
    delay_s: float = 0.0
    jitter_s: float = 0.0
    """Each packet takes so much longer or shorter, by chance: so they overtake one another."""
    rate_bps: float | None = None
    largest_bytes: int | None = None
    """Larger packets are lost, and nobody is told."""
    is_cut: bool = False
    free_s: float = 0.0
    passed_count: int = 0
    lost_count: int = 0

    def arrival_s(self, size_bytes: int, now_s: float, dice: random.Random) -> float | None:
        """Return when a packet comes out at the other end; None where it does not."""
        too_large = self.largest_bytes is not None and size_bytes > self.largest_bytes
        if self.is_cut or too_large or dice.random() < self.loss:
            self.lost_count += 1
            return None
        begin_s = now_s
        if self.rate_bps is not None:
            begin_s = max(now_s, self.free_s)
            if begin_s - now_s > _LONGEST_QUEUE_S:
                self.lost_count += 1
                return None
            begin_s = self.free_s = begin_s + 8.0 * size_bytes / self.rate_bps
        self.passed_count += 1
        return begin_s + max(0.0, self.delay_s + dice.uniform(-self.jitter_s, self.jitter_s))


class Rooms:
    """Both namespaces and the line between them."""

    def __init__(self, seed: int = 1) -> None:
        tag = f"vbr{os.getpid()}"
        self.device, self.console = f"{tag}d", f"{tag}c"
        self.up, self.down = Way(), Way()
        self._dice = random.Random(seed)
        self._tuns: list[int] = []
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="line", daemon=True)
        try:
            for name, address in ((self.device, DEVICE_IP), (self.console, CONSOLE_IP)):
                self._tuns.append(_joined_namespace(name, address))
        except BaseException:
            self.close()
            raise
        self._thread.start()

    def mend(self) -> None:
        """Let everything pass at once."""
        self.up, self.down = Way(), Way()

    def both(self, **how: float | bool | None) -> None:
        """Let both directions be so."""
        self.up, self.down = Way(**how), Way(**how)  # type: ignore[arg-type]

    def move_device(self, old: str, new: str) -> None:
        """Give the device another address."""
        ip("-n", self.device, "addr", "del", f"{old}/24", "dev", "line")
        ip("-n", self.device, "addr", "add", f"{new}/24", "dev", "line")

    def close(self) -> None:
        """Take it all down."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()
        for tun in self._tuns:
            os.close(tun)
        for name in (self.device, self.console):
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)

    def _carry(self) -> None:
        waiting: list[tuple[float, int, int, bytes]] = []
        numbers = itertools.count()
        while not self._stopped.is_set():
            now_s = time.monotonic()
            pause_s = 0.05 if not waiting else min(0.05, max(0.0, waiting[0][0] - now_s))
            readable, _, _ = select.select(self._tuns, [], [], pause_s)
            for tun in readable:
                packet = os.read(tun, _PACKET_BYTES)
                is_up = tun == self._tuns[0]
                way = self.up if is_up else self.down
                at_s = way.arrival_s(len(packet), time.monotonic(), self._dice)
                if at_s is not None:
                    heapq.heappush(waiting, (at_s, next(numbers), self._tuns[1 if is_up else 0], packet))
            while waiting and waiting[0][0] <= time.monotonic():
                _, _, tun, packet = heapq.heappop(waiting)
                with contextlib.suppress(OSError):
                    os.write(tun, packet)


def why_impossible() -> str:
    """Return why no such rooms can be made here; empty where they can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if shutil.which("ip") is None:
        return "network namespaces need iproute2"
    if not Path("/dev/net/tun").exists():
        return "the line between the namespaces needs /dev/net/tun"
    name = f"vbr{os.getpid()}t"
    try:
        tun = _joined_namespace(name, DEVICE_IP)
    except (OSError, subprocess.CalledProcessError) as error:
        return f"no network namespace can be made here ({error})"
    finally:
        subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)
    os.close(tun)
    return ""


def ip(*arguments: str) -> None:
    """Run iproute2's ip."""
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


@contextlib.contextmanager
def inside(namespace: str) -> Iterator[None]:
    """Let this thread's new sockets be in a namespace; they stay there afterwards."""
    libc = ctypes.CDLL(None, use_errno=True)
    with open(f"/proc/self/task/{threading.get_native_id()}/ns/net") as here:
        with open(f"/run/netns/{namespace}") as there:
            if libc.setns(there.fileno(), _CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "setns")
        try:
            yield
        finally:
            libc.setns(here.fileno(), _CLONE_NEWNET)


def _joined_namespace(name: str, address: str) -> int:
    """Make a namespace whose only way out is a TUN device, and return that device's other end."""
    ip("netns", "add", name)
    tun = os.open("/dev/net/tun", os.O_RDWR | os.O_CLOEXEC)
    try:
        device = f"{name}l"
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH14s", device.encode(), _IFF_TUN | _IFF_NO_PI, b""))
        ip("link", "set", device, "netns", name, "name", "line")
        ip("-n", name, "link", "set", "lo", "up")
        ip("-n", name, "addr", "add", f"{address}/24", "dev", "line")
        ip("-n", name, "link", "set", "line", "up")
    except BaseException:
        os.close(tun)
        raise
    return tun


class Names:
    """A name server in a namespace, at the console's address: it answers, denies, or says nothing at all."""

    def __init__(self, rooms: Rooms) -> None:
        self.answers: str = "nothing"
        """``here``: the console's address; ``denied``: no such name; ``empty``: no address; ``nothing``: silence."""
        self.asked_count = 0
        with inside(rooms.console):
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.bind((CONSOLE_IP, 53))
        self._socket.settimeout(0.2)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._answer_all, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._stopped.set()
        self._thread.join()
        self._socket.close()

    def _answer_all(self) -> None:
        while not self._stopped.is_set():
            with contextlib.suppress(TimeoutError):
                query, asker = self._socket.recvfrom(1024)
                self.asked_count += 1
                if self.answers != "nothing":
                    self._socket.sendto(self._answered(query), asker)

    def _answered(self, query: bytes) -> bytes:
        end = 12
        while query[end]:
            end += query[end] + 1
        question, kind = query[12 : end + 5], struct.unpack("!H", query[end + 1 : end + 3])[0]
        has_address = self.answers == "here" and kind == 1
        flags = 0x8183 if self.answers == "denied" else 0x8180
        head = query[:2] + struct.pack("!HHHHH", flags, 1, int(has_address), 0, 0)
        if not has_address:
            return head + question
        address = b"\xc0\x0c" + struct.pack("!HHIH", 1, 1, 0, 4) + socket.inet_aton(CONSOLE_IP)
        return head + question + address
