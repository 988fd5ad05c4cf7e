"""The link: the device dials out to the console, over one WebSocket, for ever.

Everything happens in a thread of its own with its own event loop; guidance hands over to the outbox and the journal and
never waits. When the connection breaks, the link joins again by itself, with growing, jittered pauses, and sends what
was missed. Message table: :mod:`navcore.wire`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading

import msgspec
import numpy as np
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException

from device_agent.journal import EventJournal
from device_agent.link_settings import LinkedDevice, LinkRefusedError, LinkSettings
from device_agent.map_download import fetch_map
from device_agent.outbox import Outbox
from device_agent.ports import Clock, EventKind, KeptMessage
from device_agent.silhouette import silhouette_jpeg
from navcore.errors import VbrError, WireError
from navcore.types import Frame
from navcore.wire import (
    MAX_MESSAGE_BYTES,
    PROTOCOL_VERSION,
    ConsoleMessage,
    DepthImage,
    DeviceMessage,
    EventConfirmed,
    MapAvailable,
    MapRunning,
    Ping,
    Pong,
    WalkerState,
    Welcome,
    decode_from_console,
    encode,
)

_log = logging.getLogger(__name__)
_STEADY_AFTER_S = 5.0
_LEAST_WAIT_S = 0.02
_REFUSED_STATUS = (401, 403)
_REFUSED_CODES = (1008, 4401, 4403)


class ConsoleLink:
    """The device's end of the link; an :class:`~device_agent.ports.Uplink`."""

    def __init__(self, settings: LinkSettings, journal: EventJournal, clock: Clock) -> None:
        self._settings = settings
        self._device: LinkedDevice
        self._journal = journal
        self._clock = clock
        self._outbox = Outbox(self._wake)
        self._events_stored = True
        journal.on_stored = self._wake_for_events
        self._rng = np.random.default_rng(settings.seed)
        self._stopping = False
        self._refusal = ""
        self._download: asyncio.Task[None] | None = None
        self._fetching = ""
        self._loop = asyncio.new_event_loop()
        self._something_to_send = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="link", daemon=True)

    # ------------------------------------------------------------------------------------------------ uplink
    def state(self, state: WalkerState) -> None:
        """Offer the newest state."""
        self._outbox.offer_state(state)

    def depth_image(self, frame: Frame) -> None:
        """Offer the newest depth image."""
        self._outbox.offer_frame(frame)

    def message(self, message: KeptMessage) -> None:
        """Hand over a message that is kept until it is sent."""
        self._outbox.keep(message)

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Hand over an event that is kept until it is confirmed."""
        self._journal.append(stamp_s, kind, text)

    # ---------------------------------------------------------------------------------------------- lifetime
    def start(self, device: LinkedDevice) -> None:
        """Begin to dial for a device, in a thread of its own."""
        self._device = device
        self._thread.start()

    def stop(self) -> None:
        """Leave the console and end the thread."""
        self._stopping = True
        if not self._thread.ident:
            self._loop.close()
            return
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._cancel_all)
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def _cancel_all(self) -> None:
        for task in asyncio.all_tasks(self._loop):
            task.cancel()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        with contextlib.suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._stay_joined())
        self._loop.run_until_complete(self._loop.shutdown_default_executor())
        self._loop.close()

    def _wake(self) -> None:
        # The loop is closed once the link has been stopped; what comes after that waits in the journal.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._something_to_send.set)

    def _wake_for_events(self) -> None:
        self._events_stored = True
        self._wake()

    # ---------------------------------------------------------------------------------------------- joining
    async def _stay_joined(self) -> None:
        failures = 0
        while not self._stopping:
            began_s = self._loop.time()
            reason = await self._session_until_it_breaks()
            lasted_s = self._loop.time() - began_s
            failures = 1 if lasted_s > _STEADY_AFTER_S else failures + 1
            refused = isinstance(reason, LinkRefusedError)
            self._tell_of(reason, lasted_s)
            await asyncio.sleep(self._settings.refused_pause_s if refused else self._pause_s(failures))

    def _pause_s(self, failures: int) -> float:
        """Return a pause that doubles with each failure, and is somewhere in its upper half."""
        longest = min(self._settings.longest_pause_s, self._settings.first_pause_s * 2.0 ** min(failures - 1, 30))
        return float(longest * self._rng.uniform(0.5, 1.0))

    async def _session_until_it_breaks(self) -> Exception:
        try:
            await self._session()
        except InvalidStatus as error:
            if error.response.status_code in _REFUSED_STATUS:
                return LinkRefusedError(
                    "The console refuses this device's token: make a new one there and give it to the device."
                )
            return error
        except ConnectionClosed as error:
            if error.rcvd is not None and error.rcvd.code in _REFUSED_CODES:
                return LinkRefusedError(f"The console refuses this device: {error.rcvd.reason or 'no reason given'}.")
            return error
        except (OSError, WebSocketException, VbrError) as error:
            return error
        except Exception as error:
            # Whatever it was, a device that never calls again would be worse.
            _log.exception("the link failed")
            return error
        return ConnectionError("the console closed the link")

    def _tell_of(self, reason: Exception, lasted_s: float) -> None:
        _log.info("no link to the console after %.1f s: %s", lasted_s, reason)
        if isinstance(reason, LinkRefusedError) and str(reason) != self._refusal:
            self._refusal = str(reason)
            _log.warning("%s", reason)
            self.event(self._clock.now_s(), "link", str(reason))

    async def _session(self) -> None:
        async with connect(
            self._settings.url.rstrip("/") + "/device",
            additional_headers={"Authorization": f"Bearer {self._settings.token}"},
            ssl=self._settings.tls,
            max_size=MAX_MESSAGE_BYTES,
            write_limit=32_768,
            open_timeout=self._settings.answer_timeout_s,
            ping_interval=self._settings.answer_timeout_s,
            ping_timeout=self._settings.answer_timeout_s,
            close_timeout=1.0,
            proxy=None,
        ) as socket:
            await self._join(socket)
            sending = asyncio.create_task(self._send_all(socket))
            receiving = asyncio.create_task(self._receive_all(socket))
            try:
                await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
            finally:
                await _ended(sending, receiving)
                if not self._stopping:
                    self.event(self._clock.now_s(), "link", "The console is gone.")
            for task in (receiving, sending):
                if not task.cancelled():
                    task.result()

    async def _join(self, socket: ClientConnection) -> None:
        hello = msgspec.structs.replace(self._device.hello(), now_s=self._clock.now_s())
        await socket.send(encode(hello))
        async with asyncio.timeout(self._settings.answer_timeout_s):
            welcome = decode_from_console(_binary(await socket.recv()))
        if not isinstance(welcome, Welcome):
            raise WireError("The console did not begin with a welcome: use the same version on both sides.")
        if welcome.protocol_version != PROTOCOL_VERSION:
            raise LinkRefusedError(
                f"The console speaks protocol {welcome.protocol_version}, this device {PROTOCOL_VERSION}:"
                " update the older of the two."
            )
        await asyncio.to_thread(self._journal.agree, welcome.last_event_sequence)
        self._refusal = ""
        self._outbox.joined()
        self._events_stored = True
        self.event(self._clock.now_s(), "link", "Joined the console.")

    # ---------------------------------------------------------------------------------------------- sending
    async def _send_all(self, socket: ClientConnection) -> None:
        sent_sequence = 0
        while True:
            self._something_to_send.clear()
            await self._send_kept(socket)
            sent_sequence = await self._send_events(socket, sent_sequence)
            await self._send_newest(socket)
            wait_s = self._outbox.wait_s(self._loop.time())
            if wait_s is not None:
                # A picture that is due waits for a slow network; asking without a pause would starve guidance.
                wait_s = max(wait_s, _LEAST_WAIT_S)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._something_to_send.wait(), wait_s)

    async def _send_kept(self, socket: ClientConnection) -> None:
        while (message := self._outbox.next_kept()) is not None:
            try:
                await socket.send(encode(message))
            except BaseException:
                self._outbox.put_back(message)
                raise

    async def _send_events(self, socket: ClientConnection, sent_sequence: int) -> int:
        if not self._events_stored:
            return sent_sequence
        self._events_stored = False
        while events := await asyncio.to_thread(self._journal.pending, sent_sequence):
            for event in events:
                await socket.send(encode(event))
                sent_sequence = event.sequence
        return sent_sequence

    async def _send_newest(self, socket: ClientConnection) -> None:
        state = self._outbox.next_state(self._loop.time())
        if state is not None:
            await socket.send(encode(state))
        elif socket.transport.get_write_buffer_size() == 0:
            frame = self._outbox.next_frame(self._loop.time())
            if frame is not None:
                await socket.send(encode(DepthImage(frame.stamp_s, silhouette_jpeg(frame.depth_m))))

    # -------------------------------------------------------------------------------------------- receiving
    async def _receive_all(self, socket: ClientConnection) -> None:
        async for data in socket:
            try:
                message = decode_from_console(_binary(data))
                answer = await self._take(message)
            except WireError as error:
                _log.warning("the link is closed and opened anew: %s", error)
                raise
            if answer is not None:
                await socket.send(encode(answer))

    async def _take(self, message: ConsoleMessage) -> DeviceMessage | None:
        match message:
            case Ping():
                return Pong(message.console_now_s, self._clock.now_s())
            case EventConfirmed():
                await asyncio.to_thread(self._journal.confirm, message.sequence)
            case MapAvailable():
                return self._take_map(message)
            case Welcome():
                raise WireError("The console said welcome twice: use the same version on both sides.")
            case _:
                self._device.submit(message)
        return None

    def _take_map(self, offer: MapAvailable) -> MapRunning | None:
        running = self._device.hello().map_checksum
        if offer.map_checksum == running:
            return MapRunning(running)
        if self._download is not None and not self._download.done():
            if offer.map_checksum == self._fetching:
                return None
            self._download.cancel()
        self._fetching = offer.map_checksum
        self._download = asyncio.create_task(self._fetch(offer))
        return None

    async def _fetch(self, offer: MapAvailable) -> None:
        settings = self._settings
        try:
            await fetch_map(offer, settings.url, settings.token, settings.staging, settings.tls)
            await asyncio.to_thread(self._device.map_arrived, settings.staging, offer.map_checksum)
        except Exception as error:
            # Whatever is wrong with it, the console is told, and the old map runs on.
            _log.warning("the offered map is not taken: %s", error)
            self.message(MapRunning(self._device.hello().map_checksum, str(error)[:500]))


async def _ended(*tasks: asyncio.Task[None]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def _binary(data: str | bytes) -> bytes:
    if isinstance(data, str):
        raise WireError("The console sent text where a message was due: use the same version on both sides.")
    return data
