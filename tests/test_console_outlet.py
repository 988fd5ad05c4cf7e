"""What waits for a device goes by the table's priority, never grows without bound, and ends with a sentence."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

from hypothesis import given
from hypothesis import strategies as st

from console.outlet import OVERFLOW_CODE, QUEUED_MAX_COUNT, Closing, SocketOutlet
from navcore.planning.poi_graph import PoiGraph
from navcore.wire import (
    MESSAGES,
    ApplySettings,
    ConsoleMessage,
    EventConfirmed,
    Pause,
    Ping,
    PublishGraph,
    Say,
    SetDestination,
    Welcome,
)
from navcore.wire_row import Delivery

MESSAGES_DOWN: list[ConsoleMessage] = [
    PublishGraph(PoiGraph(1)), ApplySettings(1, {}), Say("One."), Pause(), SetDestination("bar"), EventConfirmed(7),
    Ping(1.0), Welcome(3, 0),
]  # fmt: skip


def sent_after(fill: Callable[[SocketOutlet], None]) -> list[ConsoleMessage | Closing]:
    """Fill an outlet while nobody empties it, close it, and return what is sent then."""

    async def empty() -> list[ConsoleMessage | Closing]:
        outlet = SocketOutlet(asyncio.get_running_loop())
        filling = threading.Thread(target=lambda: (fill(outlet), outlet.close(4409, "Enough.")))
        filling.start()
        filling.join()
        await asyncio.sleep(0)
        sent = [await outlet.next()]
        while not isinstance(sent[-1], Closing):
            sent.append(await outlet.next())
        return sent

    return asyncio.run(empty())


def fill_with(*messages: ConsoleMessage) -> Callable[[SocketOutlet], None]:
    return lambda outlet: [outlet.send(message) for message in messages] and None


@given(st.lists(st.sampled_from(MESSAGES_DOWN), max_size=30))
def test_what_waits_goes_by_priority_and_within_one_in_order(messages: list[ConsoleMessage]) -> None:
    *sent, end = sent_after(fill_with(*messages))
    assert end == Closing(4409, "Enough.")
    priorities = [MESSAGES[type(message)].priority for message in sent]  # type: ignore[index]
    assert priorities == sorted(priorities)
    for priority in set(priorities):
        kept = [
            message for message in messages
            if MESSAGES[type(message)].priority == priority and MESSAGES[type(message)].delivery is not Delivery.ANSWER
        ]  # fmt: skip
        rest = [message for message in sent if MESSAGES[type(message)].priority == priority]  # type: ignore[index]
        assert [message for message in rest if not isinstance(message, Ping | EventConfirmed)] == kept


def test_of_confirmations_and_pings_the_newest_alone_goes() -> None:
    many = [message for number in range(5000) for message in (EventConfirmed(number), Ping(float(number)))]
    assert sent_after(fill_with(*many))[:-1] == [EventConfirmed(4999), Ping(4999.0)]


def test_a_device_that_takes_nothing_in_is_given_up_with_a_sentence() -> None:
    orders = [Say(str(number)) for number in range(3 * QUEUED_MAX_COUNT)]
    assert sent_after(fill_with(*orders)) == [Closing(OVERFLOW_CODE, "The device takes nothing in.")]
