"""Signing in: one-time links, sessions, roles given and taken, and what is kept of secrets."""

from __future__ import annotations

from pathlib import Path

import argon2
import pytest
from console_room import PASSWORD, PRODUCT_HASHER, HandClock, Person, first_admin, invited, serving, token_of
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from console.accounts import LINK_VALID_S, SESSION_IDLE_S, SESSION_LONGEST_S, Accounts
from console.errors import BadRequestError, ConflictError, NotFoundError, SignInError, TooManyError
from console.secrets_kept import hash_of_token
from console.store import Store
from navcore.site import Site, save_site


@pytest.fixture
def clock() -> HandClock:
    return HandClock()


@pytest.fixture
def accounts(tmp_path: Path, clock: HandClock) -> Accounts:
    return Accounts(Store.open(tmp_path, clock), clock)


@pytest.fixture
def site_folder(tmp_path: Path, small_site: Site) -> Path:
    save_site(small_site, tmp_path / "site")
    return tmp_path / "site"


def test_the_first_link_makes_an_admin_once(site_folder: Path, tmp_path: Path) -> None:
    with serving(site_folder, tmp_path / "data") as server:
        assert server.ready.first_link is not None
        person = Person(server.ready.url)
        assert person.http.get("/").headers["location"] == "/signin?next=/"
        answer = person.open_link(server.ready.first_link, "Ada")
        assert answer.status_code == 200
        cookie = answer.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        assert person.http.get("/api/session").json()["role"] == "admin"
        again = Person(server.ready.url).open_link(server.ready.first_link, "Eve")
        assert again.status_code == 404
        assert "has been used" in again.json()["error"]
        assert Person(server.ready.url).sign_in("ada ").status_code == 200
    with serving(site_folder, tmp_path / "data") as server:
        assert server.ready.first_link is None
        assert person.http.cookies


def test_nobody_gets_in_without_an_account(accounts: Accounts) -> None:
    for name, password in (("admin", "admin"), ("root", ""), ("", "")):
        with pytest.raises(SignInError):
            accounts.sign_in(name, password, "10.0.0.1")


def test_each_start_voids_the_link_of_the_one_before(accounts: Accounts) -> None:
    old, new = accounts.first_admin_link_token(), accounts.first_admin_link_token()
    assert old is not None
    assert new is not None
    with pytest.raises(NotFoundError):
        accounts.use_link(old, "Ada", PASSWORD)
    accounts.use_link(new, "Ada", PASSWORD)
    assert accounts.first_admin_link_token() is None


def test_a_link_expires(accounts: Accounts, clock: HandClock) -> None:
    token = accounts.first_admin_link_token()
    assert token is not None
    clock.s += LINK_VALID_S + 1
    with pytest.raises(NotFoundError, match="expired"):
        accounts.use_link(token, "Ada", PASSWORD)


def test_a_short_password_leaves_the_link_usable(accounts: Accounts) -> None:
    token = accounts.first_admin_link_token()
    assert token is not None
    with pytest.raises(BadRequestError, match="at least 10"):
        accounts.use_link(token, "Ada", "short")
    with pytest.raises(BadRequestError, match="name"):
        accounts.use_link(token, "\x00", PASSWORD)
    assert accounts.use_link(token, "Ada", PASSWORD).role == "admin"


def with_admin(accounts: Accounts) -> int:
    token = accounts.first_admin_link_token()
    assert token is not None
    return accounts.use_link(token, "Ada", PASSWORD).id


def test_guessing_is_slowed_down_and_forgiven_later(accounts: Accounts, clock: HandClock) -> None:
    with_admin(accounts)
    for _ in range(5):
        with pytest.raises(SignInError):
            accounts.sign_in("Ada", "wrong password", "10.0.0.1")
    with pytest.raises(TooManyError, match="try again in"):
        accounts.sign_in("Ada", PASSWORD, "10.0.0.1")
    assert accounts.sign_in("Ada", PASSWORD, "10.0.0.2"), "somebody elsewhere is not locked out"
    clock.s += 6.0
    assert accounts.sign_in("Ada", PASSWORD, "10.0.0.1")


def test_unknown_and_known_names_answer_alike(accounts: Accounts) -> None:
    with_admin(accounts)
    sentences = set()
    for name in ("Ada", "Nobody"):
        with pytest.raises(SignInError) as refused:
            accounts.sign_in(name, "wrong password", "10.0.0.1")
        sentences.add(str(refused.value))
    assert len(sentences) == 1


def test_a_session_that_is_not_used_ends(accounts: Accounts, clock: HandClock) -> None:
    token = accounts.start_session(with_admin(accounts))
    clock.s += SESSION_IDLE_S - 1
    assert accounts.signed_in(token) is not None, "and it is used now, which prolongs it"
    clock.s += SESSION_IDLE_S - 1
    assert accounts.signed_in(token) is not None
    clock.s += SESSION_IDLE_S + 1
    assert accounts.signed_in(token) is None


def test_a_session_ends_even_where_it_is_used_all_the_time(accounts: Accounts, clock: HandClock) -> None:
    token, began_s = accounts.start_session(with_admin(accounts)), clock.s
    while accounts.signed_in(token) is not None:
        clock.s += SESSION_IDLE_S / 2
        assert clock.s - began_s <= SESSION_LONGEST_S + SESSION_IDLE_S
    assert clock.s - began_s > SESSION_LONGEST_S - SESSION_IDLE_S


def test_the_last_admin_stays(accounts: Accounts) -> None:
    ada = with_admin(accounts)
    for change in ({"role": "viewer"}, {"disabled": True}):
        with pytest.raises(ConflictError, match="last admin"):
            accounts.change(ada, "Ada", **change)  # type: ignore[arg-type]
    assert accounts.users()[0].role == "admin"
    bob, link = accounts.invite("Bob", "admin", "Ada")
    with pytest.raises(ConflictError):
        accounts.change(ada, "Ada", role="viewer")  # Bob has chosen no password yet.
    accounts.use_link(link, "ignored", PASSWORD)
    assert accounts.change(ada, "Bob", role="viewer").role == "viewer"
    assert bob.name == "Bob"


def test_names_are_compared_without_case_and_spacing(accounts: Accounts) -> None:
    with_admin(accounts)
    with pytest.raises(ConflictError, match="already"):
        accounts.invite("  aDA ", "viewer", "Ada")


def test_secrets_are_kept_as_hashes_only(accounts: Accounts, tmp_path: Path) -> None:
    token = accounts.start_session(with_admin(accounts))
    stored = b"".join(path.read_bytes() for path in tmp_path.iterdir())
    assert hash_of_token(token).encode() in stored
    assert token.encode() not in stored
    assert PASSWORD.encode() not in stored
    assert b"$argon2id$" in stored


def drain(socket: ClientConnection) -> None:
    for _ in socket:
        pass


def test_a_stolen_hash_is_dear_to_guess_from() -> None:
    """At least what OWASP's password storage cheat sheet asks of argon2id."""
    kept = argon2.extract_parameters(PRODUCT_HASHER.hash(PASSWORD))
    assert (kept.type, kept.memory_cost >= 19 * 1024, kept.time_cost >= 2) == (argon2.Type.ID, True, True)


def test_signing_out_a_new_role_and_a_lock_end_sockets_at_once(site_folder: Path, tmp_path: Path) -> None:
    with serving(site_folder, tmp_path / "data") as server:
        admin = first_admin(server)
        users = {}
        for name in ("Leaving", "Rising", "Locked"):
            users[name] = invited(admin, name, "viewer")
        ids = {user["name"]: user["id"] for user in admin.http.get("/api/users").json()["users"]}
        sockets = {name: person.live() for name, person in users.items()}
        for socket in sockets.values():
            socket.recv(timeout=20)
        users["Leaving"].http.post("/api/sign-out").raise_for_status()
        admin.http.patch(f"/api/users/{ids['Rising']}", json={"role": "editor"}).raise_for_status()
        admin.http.patch(f"/api/users/{ids['Locked']}", json={"disabled": True}).raise_for_status()
        for name, socket in sockets.items():
            with pytest.raises(ConnectionClosed):
                drain(socket)
            assert socket.close_code == 4401, name
            assert users[name].http.get("/api/session").status_code == 401
        assert users["Rising"].sign_in("Rising").status_code == 200
        assert users["Locked"].sign_in("Locked").status_code == 401


def test_an_invitation_sets_the_role_and_cannot_be_renamed(site_folder: Path, tmp_path: Path) -> None:
    with serving(site_folder, tmp_path / "data") as server:
        admin = first_admin(server)
        link = admin.http.post("/api/users", json={"name": "Vera", "role": "viewer"}).json()["link"]
        person = Person(server.ready.url)
        assert person.http.post("/api/first/look", json={"token": token_of(link)}).json() == {"name": "Vera"}
        person.open_link(link, "Mallory").raise_for_status()
        session = person.http.get("/api/session").json()
        assert (session["name"], session["role"]) == ("Vera", "viewer")
        actions = [line["action"] for line in admin.http.get("/api/audit").json()["audit"]]
        assert {"user_invited", "password_chosen"} <= set(actions)
