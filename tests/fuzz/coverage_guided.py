"""Coverage-guided fuzzing of every target, by atheris: the driver of ``.ci/fuzz``.

    python -m fuzz.coverage_guided [--seconds S | --runs N] [--keep FOLDER] [TARGET ...]

Begins with the valid files, with what was found once, and with what earlier runs left in FOLDER/TARGET. What is found
is made as small as can be, and printed with where to keep it. Exit status 1 where something is found.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import atheris

from fuzz.confined import Answer, ConfinedReader, limit_memory, read_once
from fuzz.mutations import spoiled

# So that it is seen which branches a file leads to. It prints a line for each module.
_OBSERVED = ["navcore", "device_agent", "console", "mcap", "zipfile", "tarfile"]
_ROOT = Path(__file__).resolve().parents[2]


def _compiled() -> Iterator[str]:
    """Yield the modules that Numba compiles: it reads their code, and knows none of what would observe it."""
    for package in ("navcore", "device_agent", "console"):
        for path in sorted((_ROOT / package).rglob("*.py")):
            if "from navcore.compiled import" in path.read_text(encoding="utf-8"):
                yield ".".join(path.relative_to(_ROOT).with_suffix("").parts)


with (
    contextlib.redirect_stderr(io.StringIO()),
    atheris.instrument_imports(include=_OBSERVED, exclude=["navcore.slam", *_compiled()]),
):
    from fuzz.every_target import TARGETS
    from fuzz.targets import Target

CORPUS = Path(__file__).resolve().parents[1] / "data" / "corpus"
MAX_BYTES = 1 << 16
_MEMORY_MIB = 4096
_PATIENCE_S = 60
"""For one file, on a busy machine; what takes so much of the processor is a fault of its own in the tests."""
_SMALLER_COUNT = 400
_SPECIAL = re.compile(r"0x[0-9a-f]+|[0-9]+|'[^']*'|\"[^\"]*\"|`[^`]*`|\([^)]*\)")


def main() -> int:
    """Fuzz the targets that are named, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=0.0, help="for all targets together")
    parser.add_argument("--runs", type=int, default=0, help="files for each target")
    parser.add_argument("--keep", type=Path, help="folder for what leads to new lines, from run to run")
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"one of {', '.join(TARGETS)}")
    options = parser.parse_args()
    if unknown := sorted(set(options.targets) - set(TARGETS)):
        parser.error(f"there is no target {unknown[0]}: choose one of {', '.join(TARGETS)}.")
    targets = [TARGETS[name] for name in options.targets or TARGETS]
    limits = _limits(options.runs, options.seconds / len(targets))
    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        found = [_fuzzed(target, Path(scratch) / target.name, limits, options.keep) for target in targets]
    return 1 if any(found) else 0


def _limits(runs: int, seconds: float) -> list[str]:
    return [f"-runs={runs}"] if runs else [f"-max_total_time={max(1, round(seconds))}"]


# ---------------------------------------------------------------------------------------------- one target
def _fuzzed(target: Target, scratch: Path, limits: list[str], keep: Path | None) -> bool:
    """Fuzz a target in a process of its own, print what came of it, and return whether something was found."""
    corpus, finds = scratch / "corpus", scratch / "finds"
    for folder in (corpus, finds):
        folder.mkdir(parents=True)
    for number, seed in enumerate(target.seeds):
        (corpus / f"seed-{number}").write_bytes(seed)
    kept = keep / target.name if keep is not None else None
    for folder in filter(None, (CORPUS / target.name, kept)):
        for path in folder.glob("*"):
            shutil.copy(path, corpus)
    began_s = time.monotonic()
    child = os.fork()
    if child == 0:
        _fuzz(target, scratch, limits)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    print(f"{target.name:24} {_figures(scratch / 'log', time.monotonic() - began_s)}", flush=True)
    if kept is not None:
        kept.mkdir(parents=True, exist_ok=True)
        for path in corpus.iterdir():
            shutil.copy(path, kept)
    return _told(target, scratch, status)


def _fuzz(target: Target, scratch: Path, limits: list[str]) -> None:
    """Fuzz until the limits are reached; this process ends with it."""
    log = os.open(scratch / "log", os.O_WRONLY | os.O_CREAT)
    os.dup2(log, 1)
    os.dup2(log, 2)
    folder, known = scratch / "files", set[str]()

    def read(data: bytes) -> None:
        answer = read_once(target.read, data, folder)
        if answer.outcome == "fault" and (kind := _kind(answer)) not in known:
            known.add(kind)
            (scratch / "finds" / hashlib.sha256(kind.encode()).hexdigest()[:12]).write_bytes(data)

    def mutated(data: bytes, max_bytes: int, seed: int) -> bytes:
        random = Random(seed)
        if random.randrange(2):
            return bytes(atheris.Mutate(data, max_bytes))
        return spoiled(data, target.form, random)[:max_bytes]

    read(target.seeds[0])
    limit_memory()
    settings = [
        f"-artifact_prefix={scratch}/finds/", f"-max_len={MAX_BYTES}", f"-rss_limit_mb={_MEMORY_MIB}", "-seed=1",
        f"-timeout={_PATIENCE_S}", "-print_final_stats=1", "-len_control=0",
    ]  # fmt: skip
    atheris.Setup([target.name, *limits, *settings, str(scratch / "corpus")], read, custom_mutator=mutated)
    atheris.Fuzz()


def _kind(answer: Answer) -> str:
    """Return what tells one fault from another: where it was raised, and what it says but for values."""
    lines = answer.text.strip().splitlines()
    places = [line.strip() for line in lines if line.strip().startswith("File ")]
    return "\n".join([*places[-1:], _SPECIAL.sub("", lines[-1])[:60]])


def _figures(log: Path, took_s: float) -> str:
    text = log.read_text(errors="replace")
    covered = re.findall(r"(INITED|DONE) +cov: (\d+) ft: (\d+) corp: (\d+)", text)
    runs = re.findall(r"stat::number_of_executed_units: (\d+)", text)
    if not covered or not runs:
        return f"{took_s:.0f} s; " + (text.strip().splitlines() or ["it said nothing"])[-1][:200]
    first, last = covered[0], covered[-1]
    count = int(runs[-1])
    return (
        f"{count:8d} files, {count / max(took_s, 0.01):6.0f}/s; branches {first[1]} → {last[1]},"
        f" features {first[2]} → {last[2]}, files kept {last[3]}"
    )


# ---------------------------------------------------------------------------------------------- what is found
def _told(target: Target, scratch: Path, status: int) -> bool:
    finds = sorted((scratch / "finds").iterdir())
    if status != 0 and not finds:
        print((scratch / "log").read_text(errors="replace")[-3000:])
        return True
    reader = ConfinedReader("fuzz.every_target")
    for path in finds:
        data = smallest(path.read_bytes(), lambda data: reader.read(target.name, data))
        answer = reader.read(target.name, data)
        name = hashlib.sha256(data).hexdigest()[:12]
        kept = Path(tempfile.gettempdir()) / f"{target.name}-{name}"
        kept.write_bytes(data)
        print(f"\nFound: {target.name}, {len(data)} bytes: {data[:200]!r}\n{answer.text or path.name}")
        print(f"To keep it: mkdir -p {CORPUS / target.name} && cp {kept} {CORPUS / target.name}/{name}\n", flush=True)
    reader.close()
    return bool(finds)


def smallest(data: bytes, read: Callable[[bytes], Answer]) -> bytes:
    """Return what is left of a file when all is left out that the same fault does not need."""
    kind = _kind(first) if (first := read(data)).outcome == "fault" else ""
    tries = 0
    for smaller_by in (1 << power for power in range(len(data).bit_length(), -1, -1)):
        for candidate in _without(data, smaller_by):
            tries += 1
            if tries > _SMALLER_COUNT:
                return data
            if (answer := read(candidate)).outcome == "fault" and _kind(answer) == kind:
                data = candidate
                break
    return data


def _without(data: bytes, count: int) -> Iterator[bytes]:
    return (data[:at] + data[at + count :] for at in range(0, len(data), count))


if __name__ == "__main__":
    sys.exit(main())
