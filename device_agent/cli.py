"""The command ``vbr``.

Sub-commands come from the entry points of the group ``vbr.commands``: each names a module with
``add_commands(subparsers)``. A sub-command sets ``run`` (``parser.set_defaults(run=function)``); ``run(arguments)``
does the work and returns the exit code, or None for 0. What goes wrong on purpose (VbrError) is one sentence on stderr
and exit code 2.
"""

from __future__ import annotations

import argparse
import importlib
import os
import re
import sys
from collections.abc import Callable, Sequence
from importlib import metadata

from device_agent.logs import log_to_stderr
from navcore.errors import MissingPackageError, VbrError

DISTRIBUTION = "virtual-blind-road"
EXIT_REFUSED = 2
EXIT_INTERRUPTED = 130

AddCommands = Callable[["argparse._SubParsersAction[argparse.ArgumentParser]"], None]


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``vbr``; return its exit code: 0 done, 2 refused (with one sentence on stderr), 130 interrupted."""
    # Read when NumPy is loaded. With more threads, small solves on busy cores are several times slower, and their last
    # digits depend on the number of cores: the same input would not give the same map.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    arguments = _parser().parse_args(argv)
    log_to_stderr(arguments.debug)
    try:
        return int(arguments.run(arguments) or 0)
    except VbrError as error:
        if arguments.debug:
            raise
        return _refuse(str(error))
    except ModuleNotFoundError as error:
        if arguments.debug or _extra_with(error.name) is None:
            raise
        return _refuse(str(missing_package(error)))
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output (head, less) has left: nobody is there to be told.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def missing_package(error: ModuleNotFoundError) -> MissingPackageError:
    """Say which extra brings the package that could not be imported."""
    extra = _extra_with(error.name)
    what = f"{DISTRIBUTION}[{extra}]" if extra else DISTRIBUTION
    return MissingPackageError(f"This command needs the package {error.name!r}: run `pip install '{what}'`.")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="vbr", description="Guides a blind person through a building along the virtual blind road."
    )
    parser.add_argument("--version", action="version", version=f"vbr {metadata.version(DISTRIBUTION)}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error, and the full log")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for entry_point in sorted(metadata.entry_points(group="vbr.commands"), key=lambda entry: entry.name):
        add_module(subparsers, entry_point.name, entry_point.value)
    return parser


def add_module(subparsers: argparse._SubParsersAction[argparse.ArgumentParser], name: str, module_name: str) -> None:
    """Add the commands of a module; where an optional package is missing, a command ``name`` that says so."""
    try:
        add_commands: AddCommands = importlib.import_module(module_name).add_commands
    except ModuleNotFoundError as error:
        _add_unavailable(subparsers, name, missing_package(error))
    else:
        add_commands(subparsers)


def _add_unavailable(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser], name: str, error: MissingPackageError
) -> None:
    def refuse(arguments: argparse.Namespace) -> int:
        raise error

    # No prefix makes an option here, so that any command line meant for the real command is taken.
    parser = subparsers.add_parser(name, help=f"not installed: {error}", prefix_chars="\0", add_help=False)
    parser.add_argument("anything", nargs="*", help=argparse.SUPPRESS)
    parser.set_defaults(run=refuse)


def _extra_with(package: str | None) -> str | None:
    """Return the extra of this distribution that brings a package, or None."""
    wanted = (package or "").partition(".")[0].replace("_", "-").lower()
    for requirement in metadata.requires(DISTRIBUTION) or ():
        match = re.match(r"([A-Za-z0-9._-]+).*extra *== *['\"]([^'\"]+)['\"]", requirement)
        if match and match[1].replace("_", "-").lower() == wanted:
            return match[2]
    return None


def _refuse(sentence: str) -> int:
    sys.stderr.write(f"vbr: {sentence}\n")
    return EXIT_REFUSED


if __name__ == "__main__":
    sys.exit(main())
