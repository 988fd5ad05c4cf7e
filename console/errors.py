"""What the console refuses, and with which HTTP status.

VbrError
└── ConsoleError            the console refuses a request; its text is one sentence
    ├── BadRequestError 400  what was sent cannot be used
    │   └── TwoLengthsError  it says in two ways how long it is
    ├── SignInError 401      nobody is signed in, or name and password do not match
    ├── ForbiddenError 403   the role may not do this
    ├── NotFoundError 404    there is no such thing
    ├── TooSlowError 408     the rest of it did not come
    ├── ConflictError 409    it was changed meanwhile, or its state does not allow it
    ├── TooLargeError 413    what was sent is larger than what is taken
    ├── TooManyError 429     asked too often
    ├── UnavailableError 503 the database or the disk cannot be used just now
    └── NoRoomError 507      the disk of the console's machine has no room for it
"""

from __future__ import annotations

from typing import Any

from navcore.errors import VbrError


class ConsoleError(VbrError):
    """The console refuses a request."""

    status = 400

    def details(self) -> dict[str, Any]:
        """Return what a page shows beside the sentence, as plain data for JSON."""
        return {}


class BadRequestError(ConsoleError):
    """What was sent cannot be used."""


class TwoLengthsError(BadRequestError):
    """It says in two ways how long it is: a proxy in front may have believed the other one. The connection ends."""


class SignInError(ConsoleError):
    """Nobody is signed in, or name and password do not match."""

    status = 401


class ForbiddenError(ConsoleError):
    """The role does not permit this."""

    status = 403


class NotFoundError(ConsoleError):
    """There is no such thing."""

    status = 404


class TooSlowError(ConsoleError):
    """The rest of it did not come."""

    status = 408


class ConflictError(ConsoleError):
    """Somebody else changed it meanwhile, or its state does not allow it."""

    status = 409


class TooLargeError(ConsoleError):
    """What was sent is larger than what is taken."""

    status = 413


class TooManyError(ConsoleError):
    """Asked too often; ``retry_after_s`` says when to try again."""

    status = 429

    def __init__(self, sentence: str, retry_after_s: float) -> None:
        super().__init__(sentence)
        self.retry_after_s = retry_after_s


class UnavailableError(ConsoleError):
    """The database or the disk of the console's machine cannot be used just now."""

    status = 503


class NoRoomError(ConsoleError):
    """The disk of the console's machine has no room for it."""

    status = 507
