"""Reads spoiled files in a process that may take little memory and little of the processor, and tells what came of it.

Whatever a file does to that process, the one that asks goes on: one that is killed, by its limits or by a fault in
compiled code, is a fault like any other, and the next file is read by a new one.
"""

from __future__ import annotations

import importlib
import os
import re
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Literal

import msgspec

from navcore.errors import VbrError

MEMORY_BYTES = 512 << 20
"""Address space beyond what the process has once everything is loaded."""
FILE_BYTES = 64 << 20
"""No file that is written may be larger."""
PEAK_BYTES = 96 << 20
"""Memory beyond what it had before, for a file of no length; and for each byte of it:"""
PEAK_PER_BYTE = 40
CPU_S = 10
LONGEST_SENTENCE = 1000
_HEAD = struct.Struct("<II")
_TESTS = Path(__file__).resolve().parents[1]


class Answer(msgspec.Struct, frozen=True):
    """What came of a file."""

    outcome: Literal["read", "refused", "fault"]
    text: str = ""
    """The sentence that refuses it, or what went wrong."""


# ------------------------------------------------------------------------------------------------ who asks
@dataclass(slots=True)
class ConfinedReader:
    """Asks a process of its own to read files. To be closed."""

    targets: str = "fuzz.targets"
    """Module with the targets."""
    cpu_s: int = CPU_S
    _process: subprocess.Popen[bytes] | None = None
    _scratch: tempfile.TemporaryDirectory[str] = field(
        default_factory=lambda: tempfile.TemporaryDirectory(prefix="fuzz-")
    )
    """Here, for a process that is killed clears nothing away."""

    def read(self, target: str, data: bytes) -> Answer:
        """Have a target read a file."""
        process = self._running()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            _send(process.stdin, target.encode(), data)
            answer, _ = _received(process.stdout)
        except (EOFError, BrokenPipeError):
            self._process = None
            return Answer("fault", f"its reader was killed ({_why(process.wait())})")
        return msgspec.json.decode(answer, type=Answer)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.communicate()
            self._process = None
        self._scratch.cleanup()

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            paths = os.pathsep.join([str(_TESTS), str(_TESTS.parent)])
            self._process = subprocess.Popen(
                [sys.executable, "-m", "fuzz.confined", self.targets, str(self.cpu_s), self._scratch.name],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=_TESTS,
                env=os.environ | {"PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"},
            )  # fmt: skip
        return self._process


def _why(code: int) -> str:
    names = {-24: "it took too much of the processor", -9: "killed", -11: "a fault in compiled code", -6: "aborted"}
    return names.get(code, f"exit status {code}")


def _send(out: BinaryIO, name: bytes, data: bytes) -> None:
    out.write(_HEAD.pack(len(name), len(data)) + name + data)
    out.flush()


def _received(source: BinaryIO) -> tuple[bytes, bytes]:
    head = source.read(_HEAD.size)
    if len(head) < _HEAD.size:
        raise EOFError
    name_bytes, data_bytes = _HEAD.unpack(head)
    return source.read(name_bytes), source.read(data_bytes)


# ------------------------------------------------------------------------------------------------ who reads
def read_once(read: Callable[[bytes, Path], object], data: bytes, folder: Path) -> Answer:
    """Let a reader read a file in a folder that is emptied first; return what came of it."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        read(data, folder)
    except VbrError as error:
        fault = _fault_of(str(error))
        return Answer("fault", f"{fault}: {str(error)[:500]!r}") if fault else Answer("refused", str(error))
    except Exception:
        return Answer("fault", traceback.format_exc(limit=-6)[-2500:])
    return Answer("read")


def _fault_of(sentence: str) -> str:
    """Return what is wrong with a sentence that refuses a file; empty where nothing is."""
    if len(sentence) > LONGEST_SENTENCE:
        return f"it is refused in {len(sentence)} characters, which nobody reads"
    if not sentence.replace("\n", "").isprintable():
        return "what refuses it holds control characters of the file, which a terminal would obey"
    if not re.search(r"(?s)\w.*[:;,.] .*\w", sentence) or not sentence.endswith((".", "…", ")")):
        return "what refuses it is no sentence that says what is wrong and what to do"
    return ""


def _status_bytes(key: str) -> int:
    found = re.search(rf"^{key}:\s+(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)
    assert found is not None
    return int(found[1]) << 10


def _peak_reset() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def _serve(targets: str, cpu_s: int, scratch: Path) -> None:
    by_name = importlib.import_module(targets).TARGETS
    answers, sys.stdout = os.fdopen(os.dup(1), "wb"), sys.stderr
    folder = scratch / "files"
    for target in by_name.values():
        # Compiled code is compiled now, and what is imported on use is imported.
        read_once(target.read, target.seeds[0], folder)
    limit_memory()
    while True:
        try:
            name, data = _received(sys.stdin.buffer)
        except EOFError:
            return
        answer = _watched(by_name[name.decode()].read, data, folder, cpu_s)
        _send(answers, msgspec.json.encode(answer), b"")


def limit_memory() -> None:
    """Let this process take little more memory than it has, and write no large files."""
    _set_soft(resource.RLIMIT_AS, _status_bytes("VmSize") + MEMORY_BYTES)
    _set_soft(resource.RLIMIT_FSIZE, FILE_BYTES)
    _set_soft(resource.RLIMIT_CORE, 0)


def _watched(read: Callable[[bytes, Path], object], data: bytes, folder: Path, cpu_s: int) -> Answer:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    _set_soft(resource.RLIMIT_CPU, int(usage.ru_utime + usage.ru_stime) + cpu_s + 1)
    _peak_reset()
    before = _status_bytes("VmRSS")
    answer = read_once(read, data, folder)
    peak = _status_bytes("VmHWM") - before
    if peak > PEAK_BYTES + PEAK_PER_BYTE * len(data):
        return Answer("fault", f"it took {peak >> 20} MiB of memory, and is {len(data)} bytes long")
    return answer


def _set_soft(limit: int, value: int) -> None:
    resource.setrlimit(limit, (value, resource.getrlimit(limit)[1]))


if __name__ == "__main__":
    _serve(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
