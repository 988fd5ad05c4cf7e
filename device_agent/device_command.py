"""``vbr device``: the process on the glasses."""

from __future__ import annotations

import argparse
import signal
import ssl
import threading
from pathlib import Path
from urllib.parse import urlsplit

from device_agent.device_options import DeviceOptions
from device_agent.recording.options import add_recording_options, recording_options
from device_agent.sensor_names import named, names_of
from device_agent.simulation_options import add_simulation_options
from device_agent.state_folder import checked_device_id, default_state_folder
from navcore.errors import InputError
from navcore.settings import Settings, parse_assignment

_LOOPBACK = ("localhost", "127.0.0.1", "::1")


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr device``."""
    parser = subparsers.add_parser("device", help="run the device agent: the process on the glasses")
    parser.add_argument("--site", type=Path, required=True, metavar="DIR", help="the map to walk in")
    parser.add_argument(
        "--without-map", action="store_true", help="begin off duty where DIR holds no map yet: to record the first one"
    )
    parser.add_argument("--to", metavar="PLACE", help="lead to this place at once; ends there when no console is named")
    add_device_options(parser)
    parser.set_defaults(run=_run)


def add_device_options(parser: argparse.ArgumentParser) -> None:
    """Add what names a device's folder, console, sensors and outputs."""
    parser.add_argument("--device-id", default="glasses", help="how the console tells devices apart")
    parser.add_argument("--state", type=Path, metavar="DIR", help="folder for settings and events over a restart")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="change a setting")

    console = parser.add_argument_group("console")
    console.add_argument("--console", metavar="URL", help="ws://127.0.0.1:PORT or wss://HOST:PORT")
    console.add_argument("--token-file", type=Path, metavar="FILE", help="holds the token that the console gave")
    console.add_argument("--ca-file", type=Path, metavar="FILE", help="certificate of a console that has its own")

    sensors = parser.add_argument_group("sensors")
    sensors.add_argument("--simulated", action="store_true", help="walk in the simulated building, in real time")
    sensors.add_argument("--recording", type=Path, metavar="DIR", help="play a recording as the camera")
    sensors.add_argument("--camera", metavar="NAME", help=f"the depth camera: {names_of('camera')}")
    sensors.add_argument("--fisheye", metavar="DEVICE", help="the fisheye camera, /dev/video2 or a video file")
    sensors.add_argument("--fisheye-calibration", type=Path, metavar="FILE", help="its lens, picture size and mounting")
    sensors.add_argument("--sonar", metavar="NAME", help=f"the rangefinder: {names_of('sonar')}")
    sensors.add_argument("--buttons", metavar="NAME", help=f"what the walker can press: {names_of('buttons')}")
    sensors.add_argument("--start", default="Hall", metavar="PLACE", help="where the simulated walker stands")
    add_simulation_options(sensors, seed=1)

    sound = parser.add_argument_group("sound")
    sound.add_argument("--wav", type=Path, metavar="FILE", help="write what is heard as a stereo WAV file")
    sound.add_argument("--sound", action="store_true", help="play on the sound device (extra 'audio')")
    sound.add_argument("--quiet", action="store_true", help="do not print the cues")
    sight = parser.add_argument_group("sight")
    sight.add_argument("--display", metavar="NAME", help=f"the glasses' displays: {names_of('display')}")
    sight.add_argument("--overlay", type=Path, metavar="DIR", help="write what both eyes see as PNG pictures")
    add_recording_options(parser.add_argument_group("recording"))


def checked_console_url(url: str) -> str:
    """Return the console's address. Raises InputError where it is none, or would send the token in the clear."""
    try:
        parts = urlsplit(url)
        is_address = parts.scheme in ("ws", "wss") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        is_address = False
    if not is_address:
        raise InputError(f"{url!r} is no address of a console: write ws:// or wss://, host and port.")
    if parts.scheme == "ws" and parts.hostname not in _LOOPBACK:
        raise InputError(f"{url} would send the device's token in the clear: use wss:// beyond this machine.")
    return f"{parts.scheme}://{parts.netloc}"


def read_token(path: Path | None) -> str:
    """Return the device's token. Raises InputError."""
    if path is None:
        raise InputError("The console asks for a token: name the file that holds it with --token-file.")
    try:
        token = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"The token file {path} cannot be read: make a device token in the console.") from error
    if not token or not token.isascii() or not token.isprintable() or " " in token:
        raise InputError(f"{path} holds no token: make a device token in the console and put it there.")
    return token


def read_ca_file(ca_file: Path | None) -> ssl.SSLContext | None:
    """Return how to trust a console that has its own certificate; None for the usual way. Raises InputError."""
    if ca_file is None:
        return None
    try:
        return ssl.create_default_context(cafile=ca_file)
    except (OSError, ssl.SSLError) as error:
        raise InputError(f"{ca_file} is no certificate ({error}): name the console's certificate (PEM).") from error


def _run(arguments: argparse.Namespace) -> int:
    if not _cameras(arguments):
        raise InputError("The device needs sensors: name --simulated, --recording DIR, or --camera NAME.")
    options = device_options(arguments)
    from device_agent.device_process import run_device

    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())
    return run_device(options, stopped)


def _cameras(arguments: argparse.Namespace) -> int:
    """Count the cameras that are named."""
    return sum([arguments.simulated, arguments.recording is not None, arguments.camera is not None])


def _refuse_contradictions(arguments: argparse.Namespace) -> None:
    if _cameras(arguments) > 1:
        raise InputError("The device has one camera: name only one of --simulated, --recording DIR and --camera NAME.")
    if arguments.simulated and (arguments.fisheye or arguments.sonar):
        raise InputError("The simulated walker has sensors of their own: leave --fisheye and --sonar out.")
    if arguments.fisheye is None and arguments.fisheye_calibration is not None:
        raise InputError("There is no fisheye camera for the calibration: name --fisheye DEVICE as well.")
    if arguments.recording is not None and arguments.fisheye is not None:
        raise InputError("A recording has its own fisheye pictures: leave --fisheye out.")


def device_options(arguments: argparse.Namespace) -> DeviceOptions:
    """Return what the command line says, checked. Raises InputError."""
    changes = dict(parse_assignment(text) for text in arguments.set)
    Settings().changed(changes)
    _refuse_contradictions(arguments)
    checked_device_id(arguments.device_id)
    url = checked_console_url(arguments.console) if arguments.console else None
    token = read_token(arguments.token_file) if url else ""
    return DeviceOptions(
        site=arguments.site,
        state=arguments.state or default_state_folder(arguments.device_id),
        device_id=arguments.device_id,
        console_url=url,
        token=token,
        tls=read_ca_file(arguments.ca_file),
        changes=changes,
        without_map=arguments.without_map,
        to=arguments.to,
        recording=arguments.recording,
        camera=named("camera", arguments.camera),
        fisheye=arguments.fisheye,
        fisheye_calibration=arguments.fisheye_calibration,
        sonar=named("sonar", arguments.sonar),
        buttons=named("buttons", arguments.buttons),
        screen=named("display", arguments.display),
        seed=arguments.seed,
        start=arguments.start,
        rate_hz=arguments.rate_hz,
        size_px=arguments.size,
        wav=arguments.wav,
        sound=arguments.sound,
        print_cues=not arguments.quiet,
        overlay=arguments.overlay,
        record=recording_options(arguments, arguments.device_id),
        shares_walks=arguments.share_walks,
    )
