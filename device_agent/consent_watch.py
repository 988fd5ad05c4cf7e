"""What the walker shares can be said beside the running device (``vbr consent``): it heeds that within a second."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

from device_agent.device_store import DeviceStore
from device_agent.sharing import NOTHING_SHARED, Consent
from navcore.errors import InputError, VbrError
from navcore.repeating import Repeating

LOOK_EVERY_S = 1.0
_log = logging.getLogger(__name__)


class ConsentWatch:
    """Looks at the file in which consent is kept, in a thread of its own, and hands over what others have written."""

    def __init__(
        self,
        store: DeviceStore,
        default: Consent,
        submit: Callable[[Consent], None],
        seen: tuple[int, int] | None,
    ) -> None:
        """``default`` holds where nothing was ever said; ``seen`` is the file's stamp before it was last read."""
        self._store, self._default, self._submit = store, default, submit
        self._seen = seen
        self._newest_version = 0
        self._looking = Repeating("consent", LOOK_EVERY_S, self.look)

    def start(self) -> None:
        """Begin to look."""
        self._looking.start()

    def stop(self) -> None:
        """Look no more."""
        self._looking.close()

    def look(self) -> None:
        """Hand over what is kept, where the file is another one than at the last look."""
        stamp = self._store.consent_stamp()
        if stamp == self._seen:
            return
        try:
            self._submit(self._read())
        except VbrError as error:
            # The file is looked at again: consent that was withdrawn is not to be overlooked.
            _log.warning("%s", error)
            return
        self._seen = stamp

    def _read(self) -> Consent:
        try:
            consent = self._store.load_consent(self._default)
        except InputError as error:
            _log.warning("%s", error)
            return NOTHING_SHARED
        if consent.version < self._newest_version:
            # The file was lost, or put back: what it says can only share less.
            return replace(consent, version=0)
        self._newest_version = consent.version
        return consent
