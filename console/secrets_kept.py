"""Random tokens and passwords, and the hashes that are kept of them."""

from __future__ import annotations

import hashlib
import secrets

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from console.errors import BadRequestError

TOKEN_BYTES = 32
MIN_PASSWORD_LENGTH = 10
MAX_PASSWORD_LENGTH = 200
_hasher = PasswordHasher()
_HASH_OF_NOTHING = _hasher.hash(secrets.token_urlsafe(TOKEN_BYTES))


def new_token() -> str:
    """Return a random token of 256 bits, fit for a URL, a cookie and a header."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def hash_of_token(token: str) -> str:
    """Return what is stored of a token. A token is random already, so a fast hash keeps it."""
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).hexdigest()


def hash_of_password(password: str) -> str:
    """Return what is stored of a password (argon2id). Raises BadRequestError where it is too short or too long."""
    if len(password) < MIN_PASSWORD_LENGTH:
        raise BadRequestError(f"This password is too short: choose at least {MIN_PASSWORD_LENGTH} characters.")
    if len(password) > MAX_PASSWORD_LENGTH:
        raise BadRequestError(f"This password is too long: choose at most {MAX_PASSWORD_LENGTH} characters.")
    return _hasher.hash(password)


def password_matches(password: str, stored_hash: str | None) -> bool:
    """Say whether a password is the one; takes as long where there is none, so that time does not tell names."""
    try:
        _hasher.verify(stored_hash or _HASH_OF_NOTHING, password[:MAX_PASSWORD_LENGTH])
    except (VerificationError, InvalidHashError):
        return False
    return bool(stored_hash)
