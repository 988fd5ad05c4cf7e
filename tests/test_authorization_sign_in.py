"""Signing in under attack: guessing, locking out, telling names apart, cookies that others planted, proxies."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from authorization_room import HOST, ORIGIN, Room, authorization_room
from console_room import PASSWORD, HandClock, serving
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from console import accounts as accounts_module
from console.accounts import (
    ACCOUNT_WAITS_S,
    FAILURES_OF_ACCOUNT_COUNT,
    FAILURES_OF_ADDRESS_COUNT,
    MAX_HASHING_COUNT,
    Accounts,
)
from console.errors import NotFoundError, SignInError, TooManyError
from console.sign_in_limit import FREE_FAILURES_COUNT, LONGEST_WAIT_S, REMEMBERED_COUNT, SignInLimit, network_of
from console.store import Store
from navcore.site import Site, save_site

HOME, ELSEWHERE = "192.0.2.1", "198.51.100.7"


@pytest.fixture
def clock() -> HandClock:
    return HandClock()


@pytest.fixture
def accounts(tmp_path: Path, clock: HandClock) -> Accounts:
    """Accounts with an admin, Ada."""
    accounts = Accounts(Store.open(tmp_path, clock), clock)
    token = accounts.first_admin_link_token()
    assert token is not None
    accounts.use_link(token, "Ada", PASSWORD)
    return accounts


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with authorization_room(tmp_path_factory.mktemp("room")) as room:
        yield room


def outcome(accounts: Accounts, name: str, password: str, address: str) -> str:
    """Return what a sign-in answers, in words."""
    try:
        accounts.sign_in(name, password, address)
    except (SignInError, TooManyError) as error:
        return type(error).__name__
    return "in"


# ------------------------------------------------------------------------------------------------------- guessing
def test_guesses_that_are_made_at_once_are_as_few_as_one_after_the_other(
    accounts: Accounts, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All wait at the hash, as they would with a slow one; none of them has failed yet."""
    at_hash, go_on, hashed = threading.Semaphore(0), threading.Event(), []

    def slow(password: str, stored: str | None) -> bool:
        hashed.append(password)
        at_hash.release()
        assert go_on.wait(20.0)
        return False

    monkeypatch.setattr(accounts_module, "password_matches", slow)
    outcomes: list[str] = []
    guesses = [
        threading.Thread(target=lambda n=number: outcomes.append(outcome(accounts, "Ada", f"guess {n}", HOME)))
        for number in range(MAX_HASHING_COUNT)
    ]
    for each in guesses:
        each.start()
        assert at_hash.acquire(timeout=20.0)
    assert outcome(accounts, "Bob", "guess", ELSEWHERE) == "TooManyError", "no more are hashed at a time"
    go_on.set()
    for each in guesses:
        each.join(20.0)
    assert outcomes == ["SignInError"] * MAX_HASHING_COUNT
    rest = [outcome(accounts, "Ada", "guess", HOME) for _ in range(5)]
    assert rest == ["SignInError"] * (FREE_FAILURES_COUNT - MAX_HASHING_COUNT) + ["TooManyError"] * 4
    assert len(hashed) == FREE_FAILURES_COUNT


def test_one_address_tries_few_names_and_a_household_of_ipv6_is_one_address(accounts: Accounts) -> None:
    for number in range(FAILURES_OF_ADDRESS_COUNT):
        assert outcome(accounts, f"Name {number}", "guess", f"2001:db8::{number:x}") == "SignInError"
    assert outcome(accounts, "Another", "guess", "2001:db8::ffff") == "TooManyError"
    assert outcome(accounts, "Another", "guess", "2001:db8:0:1::1") == "SignInError"
    assert network_of("::ffff:192.0.2.1") == network_of("192.0.2.1") == "192.0.2.1"
    assert network_of("unix") == "unix"


def test_many_addresses_together_guess_slowly_and_lock_nobody_out_for_ever(
    accounts: Accounts, clock: HandClock
) -> None:
    assert outcome(accounts, "Ada", PASSWORD, HOME) == "in"
    for number in range(FAILURES_OF_ACCOUNT_COUNT):
        assert outcome(accounts, "Ada", "guess", f"203.0.{number}.1") == "SignInError"
    assert outcome(accounts, "Ada", PASSWORD, ELSEWHERE) == "TooManyError"
    assert outcome(accounts, "Ada", PASSWORD, HOME) == "in", "from where she comes nobody locks her out"
    assert outcome(accounts, "Nobody", "guess", ELSEWHERE) == "SignInError", "another account"
    clock.s += ACCOUNT_WAITS_S + 1.0
    assert outcome(accounts, "Ada", PASSWORD, ELSEWHERE) == "in"


@pytest.mark.parametrize(("of_ada", "of_guesser"), [(HOME, HOME), ("2001:db8::a", "2001:db8::b")])
def test_whoever_guesses_behind_the_same_address_locks_nobody_out_who_comes_from_there(
    accounts: Accounts, clock: HandClock, of_ada: str, of_guesser: str
) -> None:
    """One guess for each wait keeps the limit of the address full; it must be full for strangers alone."""
    assert outcome(accounts, "Ada", PASSWORD, of_ada) == "in"
    _, link = accounts.invite("Bob", "viewer", "Ada")
    accounts.use_link(link, "", PASSWORD)
    for number in range(FAILURES_OF_ADDRESS_COUNT):
        outcome(accounts, f"Name {number}", "guess", of_guesser)
    for _ in range(3):
        clock.s += LONGEST_WAIT_S + 1.0
        assert outcome(accounts, "Nobody", "guess", of_guesser) == "SignInError"
        assert outcome(accounts, "Bob", PASSWORD, of_guesser) == "TooManyError", "he has never come from there"
        assert outcome(accounts, "Ada", PASSWORD, of_ada) == "in"
    guesses = [outcome(accounts, "Ada", "guess", of_guesser) for _ in range(FREE_FAILURES_COUNT + 1)]
    assert guesses == ["SignInError"] * FREE_FAILURES_COUNT + ["TooManyError"], "her own name has its limit there"


def test_who_waits_is_told_how_long_and_waits_no_longer_than_that(accounts: Accounts, clock: HandClock) -> None:
    for _ in range(200):
        outcome(accounts, "Ada", "guess", HOME)
        clock.s += LONGEST_WAIT_S + 1.0
    assert outcome(accounts, "Ada", "guess", HOME) == "SignInError"
    with pytest.raises(TooManyError) as refused:
        accounts.sign_in("Ada", "guess", HOME)
    assert refused.value.retry_after_s <= LONGEST_WAIT_S
    clock.s += refused.value.retry_after_s
    assert outcome(accounts, "Ada", PASSWORD, HOME) == "in"


def test_success_takes_back_nobody_elses_failures(clock: HandClock) -> None:
    limit = SignInLimit(clock, 3)
    for _ in range(3):
        limit.attempt("address")
    clock.s += 6.0
    limit.succeeded(limit.attempt("address"))
    limit.succeeded(limit.attempt("address"))
    limit.attempt("address")
    with pytest.raises(TooManyError):
        limit.attempt("address")


def test_what_is_remembered_of_guesses_is_bounded(clock: HandClock) -> None:
    limit = SignInLimit(clock)
    for number in range(REMEMBERED_COUNT + 100):
        limit.attempt(f"name {number}")
    assert len(limit._failures) == REMEMBERED_COUNT


def test_a_password_that_is_changed_while_the_old_one_is_judged_lets_nobody_in(
    accounts: Accounts, monkeypatch: pytest.MonkeyPatch
) -> None:
    ada, verify = accounts.users()[0], accounts_module.password_matches

    def changed_meanwhile(password: str, stored: str | None) -> bool:
        matches = verify(password, stored)
        accounts.use_link(accounts.new_password_link(ada.id, "Ada"), "", f"{PASSWORD}!")
        return matches

    monkeypatch.setattr(accounts_module, "password_matches", changed_meanwhile)
    assert outcome(accounts, "Ada", PASSWORD, HOME) == "SignInError"


# ---------------------------------------------------------------------------------------------------- enumeration
def test_unknown_disabled_and_wrong_are_told_apart_by_nothing(
    accounts: Accounts, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same words, the same waits, and the same work: one hash of the same cost."""
    bob, link = accounts.invite("Bob", "viewer", "Ada")
    accounts.use_link(link, "", PASSWORD)
    accounts.change(bob.id, "Ada", disabled=True)
    accounts.invite("Invited", "viewer", "Ada")
    hashed: list[str] = []
    verify = accounts_module.password_matches

    def counted(password: str, stored: str | None) -> bool:
        hashed.append(password)
        return verify(password, stored)

    monkeypatch.setattr(accounts_module, "password_matches", counted)
    told: dict[str, list[str]] = {}
    for number, (name, password) in enumerate(
        (("Ada", "wrong"), ("Bob", PASSWORD), ("Invited", ""), ("Nobody", PASSWORD))
    ):
        for _ in range(FREE_FAILURES_COUNT + 2):
            with pytest.raises((SignInError, TooManyError)) as refused:
                accounts.sign_in(name, password, f"203.0.113.{number}")
            told.setdefault(name, []).append(f"{type(refused.value).__name__}: {refused.value}")
    assert len({tuple(sentences) for sentences in told.values()}) == 1
    assert len(hashed) == 4 * FREE_FAILURES_COUNT
    with pytest.raises(NotFoundError) as unknown:
        accounts.link_name("no such token")
    with pytest.raises(NotFoundError) as spent:
        accounts.link_name(link)
    assert str(unknown.value) == str(spent.value)


# -------------------------------------------------------------------------------------------------------- cookies
def set_cookie(room: Room, *, by_tls: bool) -> str:
    origin = ORIGIN.replace("http", "https") if by_tls else ORIGIN
    headers = {"Host": HOST, "Origin": origin, "Content-Type": "application/json"}
    body = json.dumps({"name": "viewer", "password": PASSWORD}).encode()
    answer = room.calls.call("POST", "/api/sign-in", headers, body, by_tls=by_tls)
    assert answer.status == 200
    assert ("strict-transport-security" in answer.headers) is by_tls
    return answer.headers["set-cookie"]


def test_the_cookie_is_for_this_console_alone(room: Room) -> None:
    attributes = {each.strip().lower() for each in set_cookie(room, by_tls=False).split(";")[1:]}
    assert {"httponly", "samesite=strict", "path=/"} <= attributes
    assert not [each for each in attributes if each.startswith("domain") or each == "secure"]
    secure = set_cookie(room, by_tls=True)
    assert secure.startswith("__Host-vbr_session_8765=")
    assert {"httponly", "samesite=strict", "path=/", "secure"} <= {e.strip().lower() for e in secure.split(";")[1:]}


def test_over_tls_no_other_cookie_counts_and_no_page_in_the_clear_does_anything(room: Room) -> None:
    name, _, rest = set_cookie(room, by_tls=True).partition("=")
    token = rest.partition(";")[0]
    https = ORIGIN.replace("http", "https")

    def status(cookie: str, origin: str, method: str = "GET", path: str = "/api/session") -> int:
        headers = {"Host": HOST, "Origin": origin, "Cookie": f"{cookie}={token}"}
        return room.calls.call(method, path, headers, by_tls=True).status

    assert status(name, https) == 200
    assert status("vbr_session_8765", https) == 401, "anybody on this machine's name could have set it"
    assert status(name, ORIGIN, "POST", "/api/undo") == 403
    assert status(name, ORIGIN, "WS", "/live") == 403
    assert status(name, https, "POST", "/api/undo") == 403, "a viewer"
    assert status(name, https, "POST", "/api/sign-out") == 200


def test_signing_in_again_ends_the_session_that_the_browser_had(room: Room) -> None:
    before = room.session("viewer")
    for password, after in (("wrong", 200), (PASSWORD, 401)):
        room.call(before, "POST", "/api/sign-in", {"name": "editor", "password": password})
        assert room.call(before, "GET", "/api/session").status == after


def test_choosing_a_password_ends_the_session_that_the_browser_had(room: Room) -> None:
    admin = room.session("admin")
    link = room.services.accounts.new_admin_link_token("command line")
    chosen = {"token": link, "name": "Second", "password": PASSWORD}
    assert room.call(admin, "POST", "/api/first", {**chosen, "token": "unknown"}).status == 404
    assert room.call(admin, "GET", "/api/session").status == 200
    assert room.call(admin, "POST", "/api/first", chosen).status == 200
    assert room.call(admin, "GET", "/api/session").status == 401


# -------------------------------------------------------------------------------------------------------- proxies
@pytest.mark.parametrize("public_hosts", [frozenset(), frozenset({"console.example"})])
def test_where_somebody_comes_from_is_believed_of_a_declared_proxy_alone(
    public_hosts: frozenset[str], tmp_path: Path, small_site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data", public_hosts=public_hosts) as server:
        name = next(iter(public_hosts), None)
        host = name or server.ready.url.partition("//")[2]
        origin = f"https://{host}" if name else server.ready.url
        sent = {"Host": host, "Origin": origin, "X-Forwarded-Proto": "https"}
        answers = []
        for number in range(FREE_FAILURES_COUNT + 2):
            headers = sent | {"X-Forwarded-For": f"203.0.113.{number}, 198.51.100.{number}"}
            body = {"name": "Ada", "password": "guess"}
            answers.append(
                httpx.post(f"{server.ready.url}/api/sign-in", json=body, headers=headers, trust_env=False).status_code
            )
        assert (429 in answers) is not bool(name)
        addresses = {row.detail for row in server.services.store.latest_audit(50) if row.action == "sign_in_failed"}
        assert addresses == ({f"198.51.100.{n}" for n in range(FREE_FAILURES_COUNT + 2)} if name else {"127.0.0.1"})
        token = server.services.accounts.first_admin_link_token()
        chosen = {"token": token, "name": "Ada", "password": PASSWORD}
        answer = httpx.post(f"{server.ready.url}/api/first", json=chosen, headers=sent, trust_env=False)
        cookie = answer.headers["set-cookie"]
        assert cookie.startswith("__Host-") is bool(name)
        signed_in = {"Cookie": cookie.partition(";")[0]}
        invited = httpx.post(
            f"{server.ready.url}/api/users", json={"name": "Bob", "role": "viewer"}, headers=sent | signed_in,
            trust_env=False,
        )  # fmt: skip
        assert invited.json()["link"].startswith(f"{origin}/first?token=")
        with pytest.raises(InvalidStatus):
            connect(server.ready.url.replace("http", "ws") + "/live", origin="http://console.example",  # type: ignore[arg-type]
                    additional_headers=signed_in, proxy=None)  # fmt: skip
