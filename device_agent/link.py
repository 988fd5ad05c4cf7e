"""The link: the device dials out to the console, over one WebSocket, for ever.

Everything happens in a thread of its own with its own event loop; guidance hands over to the outbox and the journal and
never waits. When the connection breaks, the link joins again by itself, with growing, jittered pauses, and sends what
was missed. What goes first, and how often, is in the message table: :data:`navcore.wire.MESSAGES`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
import numpy as np
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException

from device_agent.journal import EventJournal
from device_agent.link_loop import LinkLoop
from device_agent.link_settings import LinkedDevice, LinkRefusedError, LinkSettings
from device_agent.link_state import LinkCondition, LinkState
from device_agent.logged_uplink import log_event
from device_agent.map_intake import MapIntake
from device_agent.outbox import ImageMessage, Outbox
from device_agent.ports import Clock, EventKind, KeptMessage
from device_agent.recording_uploads import RecordingUploads
from device_agent.sharing import LinkStands
from navcore.errors import VbrError, VersionError, WireError
from navcore.silhouette import colour_jpeg, silhouette_jpeg
from navcore.types import Frame
from navcore.wire import (
    MAX_MESSAGE_BYTES,
    MESSAGES,
    ColourImage,
    ConsoleMessage,
    DepthImage,
    DeviceMessage,
    EventConfirmed,
    MapAvailable,
    MapWalkSeen,
    Order,
    Ping,
    Pong,
    SharingRunning,
    WalkerState,
    Welcome,
    decode_from_console,
    decode_welcome,
    encode,
    expired_text,
)
from navcore.wire_pace import Allowances
from navcore.wire_row import Delivery, Direction

_log = logging.getLogger(__name__)
_STEADY_AFTER_S = 5.0
_LEAST_WAIT_S = 0.02
_QUIET_LOOK_S = 0.1
_REFUSED_STATUS = (401, 403)
_REVOKED_CODE = 4401
_REFUSED_CODES = (1008, _REVOKED_CODE, 4403)
_UNREADABLE_CODE = 1007


class ConsoleLink:
    """The device's end of the link; an :class:`~device_agent.ports.Uplink`."""

    def __init__(
        self,
        settings: LinkSettings,
        journal: EventJournal,
        clock: Clock,
        wait: Callable[[float], Awaitable[None]] = asyncio.sleep,
        counted_s: Callable[[], float] | None = None,
    ) -> None:
        """``wait`` lets the seconds between two attempts pass.

        ``counted_s`` tells the time by which it is counted how often messages come; by default the event loop's.
        """
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
        self._wait = wait
        self.link_state = LinkState()
        """Replaced as a whole: any thread may read it."""
        self.on_link_state: Callable[[LinkState], None] = lambda state: None
        """Called in the link's thread when the link stands otherwise, or the clocks' offset is another."""
        self.open_walk: Callable[[], Path | None] = lambda: None
        """Tells which file of a walk is being written; set before the start."""
        self._loop = LinkLoop()
        self._counted_s = counted_s or self._loop.time
        self._something_to_send = asyncio.Event()
        self._something_to_upload = asyncio.Event()
        self._sent_sequence = self._confirmed_sequence = 0
        self._thread = threading.Thread(target=self._run, name="link", daemon=True)

    # ------------------------------------------------------------------------------------------------ uplink
    def state(self, state: WalkerState) -> None:
        """Offer the newest state."""
        self._outbox.offer(state)

    def map_walk(self, seen: MapWalkSeen) -> None:
        """Offer what the map walk that is being recorded sees."""
        self._outbox.offer(seen)

    def recording_waits(self) -> None:
        """Note that there is another recording for the console's machine."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._something_to_upload.set)

    def depth_image(self, frame: Frame) -> None:
        """Offer the newest depth image."""
        self._outbox.offer_frame(DepthImage, frame)

    def colour_image(self, frame: Frame) -> None:
        """Offer the newest colour picture."""
        self._outbox.offer_frame(ColourImage, frame)

    def message(self, message: KeptMessage) -> None:
        """Hand over a message that is kept until it is sent."""
        self._outbox.keep(message)
        if isinstance(message, SharingRunning) and message.walks:
            self.recording_waits()

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Hand over an event that is kept until it is confirmed."""
        self._journal.append(stamp_s, kind, text)

    # ---------------------------------------------------------------------------------------------- lifetime
    def start(self, device: LinkedDevice) -> None:
        """Begin to dial for a device, in a thread of its own."""
        self._device = device
        self._maps = MapIntake(self._settings, device, self.message, self._pause_s, self._wait)
        self._uploads = RecordingUploads(
            self._settings, self._something_to_upload, self._until_quiet, self._pause_s, self._wait, device.submit,
            self._outbox.shares_walks, self.open_walk,
        )  # fmt: skip
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
            self._loop.run_until_complete(self._work())
        self._loop.run_until_complete(self._loop.shutdown_default_executor())
        self._loop.close()
        self._stands(LinkCondition.STOPPED)

    def _wake(self) -> None:
        # The loop is closed once the link has been stopped; what comes after that waits in the journal.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._something_to_send.set)

    def _wake_for_events(self) -> None:
        self._events_stored = True
        self._wake()

    async def _work(self) -> None:
        uploads = asyncio.create_task(self._uploads.run())
        try:
            await self._stay_joined()
        finally:
            await _ended(uploads)

    # -------------------------------------------------------------------------------------------- recordings
    async def _until_quiet(self) -> None:
        """Return once the console is there, and has confirmed every event."""
        while (
            self.link_state.condition is not LinkCondition.JOINED
            or self._events_stored
            or self._confirmed_sequence < self._sent_sequence
        ):
            await asyncio.sleep(_QUIET_LOOK_S)

    # ---------------------------------------------------------------------------------------------- joining
    async def _stay_joined(self) -> None:
        failures = 0
        while not self._stopping:
            began_s = self._clock.now_s()
            self._stands(LinkCondition.DIALLING, failure_count=failures, reason=self.link_state.reason)
            reason = await self._session_until_it_breaks()
            lasted_s = self._clock.now_s() - began_s
            failures = 1 if lasted_s > _STEADY_AFTER_S else failures + 1
            self._tell_of(reason, lasted_s)
            await self._pause_after(reason, failures)

    async def _pause_after(self, reason: Exception, failures: int) -> None:
        refused = isinstance(reason, LinkRefusedError)
        pause_s = self._settings.refused_pause_s if refused else self._pause_s(failures)
        condition = LinkCondition.REFUSED if refused else LinkCondition.WAITING
        self._stands(condition, reason=str(reason)[:500], failure_count=failures, pause_s=pause_s)
        await self._wait(pause_s)

    def _stands(
        self, condition: LinkCondition, *, reason: str = "", failure_count: int = 0, pause_s: float = 0.0
    ) -> None:
        before = self.link_state
        self._show(
            LinkState(
                condition,
                self._clock.now_s(),
                reason,
                failure_count,
                pause_s,
                before.clock_offset_s,
                before.clock_uncertainty_s,
            )
        )

    def _show(self, state: LinkState) -> None:
        self.link_state = state
        try:
            self.on_link_state(state)
        except Exception:
            _log.exception("how the link stands could not be told")

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
                return LinkRefusedError(_why_refused(error.rcvd.code, error.rcvd.reason))
            return error
        except VersionError as error:
            return LinkRefusedError(str(error))
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

    def _happened(self, text: str) -> None:
        """Tell of the link itself: in the log as well, for the console may be the one that cannot be told."""
        now_s = self._clock.now_s()
        log_event(now_s, "link", text)
        self.event(now_s, "link", text)

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
                    self._left()
            for task in (receiving, sending):
                if not task.cancelled():
                    task.result()

    def _left(self) -> None:
        """Whatever else fails: who may see what they see by this connection sees it no longer."""
        self._happened("The console is gone.")
        with contextlib.suppress(VbrError):
            self._device.submit(LinkStands(False))

    async def _join(self, socket: ClientConnection) -> None:
        hello = msgspec.structs.replace(self._device.hello(), now_s=self._clock.now_s())
        await socket.send(encode(hello))
        welcome = await self._welcome(socket)
        await asyncio.to_thread(self._journal.agree, welcome.last_event_sequence)
        self._refusal = ""
        self._outbox.joined()
        self._events_stored = True
        self._stands(LinkCondition.JOINED)
        self._device.submit(LinkStands(True))
        self._happened("Joined the console.")

    async def _welcome(self, socket: ClientConnection) -> Welcome:
        try:
            async with asyncio.timeout(self._settings.answer_timeout_s):
                return decode_welcome(_binary(await socket.recv()))
        except ConnectionClosed as error:
            if error.rcvd is not None and error.rcvd.code == _UNREADABLE_CODE:
                # So answers a console whose hello has another form.
                raise VersionError(
                    "The console cannot read this device's hello: update the older of the two"
                    f" ({error.rcvd.reason or 'no reason given'})."
                ) from error
            raise

    # ---------------------------------------------------------------------------------------------- sending
    async def _send_all(self, socket: ClientConnection) -> None:
        self._sent_sequence = self._confirmed_sequence = 0
        while True:
            self._something_to_send.clear()
            for delivery in _SENDING_ORDER:
                match delivery:
                    case Delivery.KEPT:
                        await self._send_kept(socket)
                    case Delivery.CONFIRMED:
                        await self._send_events(socket)
                    case Delivery.NEWEST:
                        await self._send_newest(socket)
                    case _:
                        await self._send_images(socket)
            if not self._events_stored:
                await self._until_something_is_due()

    async def _until_something_is_due(self) -> None:
        wait_s = self._outbox.wait_s(self._loop.time())
        if wait_s is not None:
            # A picture that is due waits for a slow network; asking without a pause would starve guidance.
            wait_s = max(wait_s, _LEAST_WAIT_S)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._something_to_send.wait(), wait_s)

    async def _send_kept(self, socket: ClientConnection) -> None:
        while (message := self._outbox.next_kept()) is not None:
            try:
                data = encode(message)
            except WireError as error:
                # Sent again and again, it would keep everything else from the console.
                _log.error("a message is not sent: %s", error)
                continue
            try:
                await socket.send(data)
            except BaseException:
                self._outbox.put_back(message)
                raise

    async def _send_events(self, socket: ClientConnection) -> None:
        """Send some of the events that wait; after a long outage, the state goes in between."""
        if not self._events_stored:
            return
        self._events_stored = False
        events = await asyncio.to_thread(self._journal.pending, self._sent_sequence)
        for event in events:
            # Before it goes: its confirmation may be quicker than the end of sending.
            self._sent_sequence = event.sequence
            await socket.send(encode(event))
        if events:
            self._events_stored = True

    async def _send_newest(self, socket: ClientConnection) -> None:
        while (message := self._outbox.next_newest(self._loop.time())) is not None:
            await socket.send(encode(message))

    async def _send_images(self, socket: ClientConnection) -> None:
        for kind, make in _IMAGES.items():
            if self._events_stored or socket.transport.get_write_buffer_size() > 0:
                return
            frame = self._outbox.next_frame(kind, self._loop.time())
            if frame is not None:
                await socket.send(encode(make(frame)))

    # -------------------------------------------------------------------------------------------- receiving
    async def _receive_all(self, socket: ClientConnection) -> None:
        allowances = Allowances(MESSAGES, Direction.DOWN, self._counted_s())
        async for data in socket:
            try:
                message = decode_from_console(_binary(data))
                if not allowances.take(type(message), self._counted_s()):
                    raise WireError(f"{type(message).__name__} comes too often: see who sends so many to this device.")
                answer = await self._take(message)
            except WireError as error:
                _log.warning("the link is closed and opened anew: %s", error)
                raise
            if answer is not None:
                await socket.send(encode(answer))

    async def _take(self, message: ConsoleMessage) -> DeviceMessage | None:
        match message:
            case Ping():
                received_s = self._clock.now_s()
                self._note_clocks(message)
                return Pong(message.console_sent_s, received_s, self._clock.now_s())
            case EventConfirmed(sequence) if sequence > self._sent_sequence:
                # What was never sent stays here for a console that stores it.
                raise WireError("The console confirms events that it was not sent: use another console.")
            case EventConfirmed():
                await asyncio.to_thread(self._journal.confirm, message.sequence)
                self._confirmed_sequence = message.sequence
            case MapAvailable():
                return self._maps.take(message)
            case Welcome():
                raise WireError("The console said welcome twice: use the same version on both sides.")
            case Order(expires_s=float(expires_s)) if expires_s < self._clock.now_s():
                # A device that stood still finds old orders in its socket.
                self._happened(expired_text(message))
            case Order(expires_s=float(expires_s)):
                self._device.submit(message, expires_s - self._clock.now_s())
            case _:
                self._device.submit(message)
        return None

    def _note_clocks(self, ping: Ping) -> None:
        before_s, offset_s, uncertainty_s = self.link_state.clock_offset_s, ping.offset_s, ping.uncertainty_s
        if offset_s is None or uncertainty_s is None:
            return
        state = msgspec.structs.replace(self.link_state, clock_offset_s=offset_s, clock_uncertainty_s=uncertainty_s)
        if before_s is None or abs(offset_s - before_s) > uncertainty_s:
            self._show(state)
        else:
            self.link_state = state


_SENDING_ORDER = tuple(
    dict.fromkeys(
        row.delivery
        for row in sorted(MESSAGES.values(), key=lambda row: row.priority)
        if row.delivery in (Delivery.KEPT, Delivery.CONFIRMED, Delivery.NEWEST, Delivery.SPARE)
    )
)
"""What is sent first, by the table's priorities."""


_IMAGES: dict[type[ImageMessage], Callable[[Frame], ImageMessage]] = {
    DepthImage: lambda frame: DepthImage(frame.stamp_s, silhouette_jpeg(frame.depth_m)),
    ColourImage: lambda frame: ColourImage(frame.stamp_s, colour_jpeg(frame.colour_rgb)),
}
"""How pictures are made, in the order in which they go."""


async def _ended(*tasks: asyncio.Task[None]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def _binary(data: str | bytes) -> bytes:
    if isinstance(data, str):
        raise WireError("The console sent text where a message was due: use the same version on both sides.")
    return data


def _why_refused(code: int, reason: str) -> str:
    if code == _REVOKED_CODE:
        return "The console has taken this device's token back: make a new one there and give it to the device."
    return f"The console refuses this device: {(reason or 'no reason given').rstrip('.')}."
