"""The API of people: signing in and out, one-time links, accounts, device tokens, the audit log."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from fastapi import FastAPI, Query, Request, Response

from console.accounts import SESSION_LONGEST_S, User
from console.bodies import MAX_NUMBER, FirstBody, InviteBody, LinkBody, Number, SignInBody, TokenBody, UserChangeBody
from console.device_store import checked_name
from console.pages import pages_for
from console.requests import Visitor, json_response, link_to
from console.security import drop_session_cookie, set_session_cookie, visitor_of
from console.services import Services

AUDIT_SHOWN_COUNT = 200
Before = Annotated[int | None, Query(ge=0, le=MAX_NUMBER)]
Wanted = Annotated[str, Query(max_length=60)]


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    _add_session_routes(app, services)
    _add_user_routes(app, services)
    _add_token_routes(app, services)
    _add_audit_route(app, services)


def _add_session_routes(app: FastAPI, services: Services) -> None:
    accounts = services.accounts

    def start_session(request: Request, token: str) -> Response:
        before = visitor_of(request)
        if before is not None and not accounts.over([before.session_id]):
            # The browser keeps one session: the one that it had would go on, and nobody could end it.
            accounts.sign_out(before)
        response = json_response({"ok": True})
        set_session_cookie(response, request, token, SESSION_LONGEST_S)
        return response

    @app.post("/api/sign-in")
    def sign_in(request: Request, body: SignInBody) -> Response:
        address = request.client.host if request.client else ""
        return start_session(request, accounts.sign_in(body.name, body.password, address))

    @app.post("/api/sign-out")
    def sign_out(request: Request, visitor: Visitor) -> Response:
        accounts.sign_out(visitor)
        response = json_response({"ok": True})
        drop_session_cookie(response, request)
        return response

    @app.get("/api/session")
    def session(visitor: Visitor) -> Response:
        return json_response(
            {
                "name": visitor.user_name,
                "role": visitor.role,
                "site": services.model.site.name,
                "pages": pages_for(visitor.role),
            }
        )

    @app.post("/api/first/look")
    def look_at_link(body: LinkBody) -> Response:
        return json_response({"name": accounts.link_name(body.token)})

    @app.post("/api/first")
    def use_link(request: Request, body: FirstBody) -> Response:
        user = accounts.use_link(body.token, body.name, body.password)
        return start_session(request, accounts.start_session(user.id))


def _add_user_routes(app: FastAPI, services: Services) -> None:
    accounts = services.accounts

    @app.get("/api/users")
    def users() -> Response:
        return json_response({"users": [_user_view(user) for user in accounts.users()]})

    @app.post("/api/users", status_code=201)
    def invite(request: Request, visitor: Visitor, body: InviteBody) -> Response:
        user, token = accounts.invite(body.name, body.role, visitor.user_name)
        return json_response({"user": _user_view(user), "link": link_to(request, token)}, 201)

    @app.patch("/api/users/{user_id}")
    def change(visitor: Visitor, user_id: Number, body: UserChangeBody) -> Response:
        user = accounts.change(user_id, visitor.user_name, body.role, body.disabled)
        return json_response({"user": _user_view(user)})

    @app.post("/api/users/{user_id}/link", status_code=201)
    def new_link(request: Request, visitor: Visitor, user_id: Number) -> Response:
        return json_response({"link": link_to(request, accounts.new_password_link(user_id, visitor.user_name))}, 201)


def _add_token_routes(app: FastAPI, services: Services) -> None:
    devices = services.devices

    @app.get("/api/tokens")
    def tokens() -> Response:
        connected = set(services.hub.connected_ids())
        return json_response(
            {
                "tokens": [
                    {**msgspec.to_builtins(token), "connected": not connected.isdisjoint(devices.ids_of(token.name))}
                    for token in devices.tokens()
                ]
            }
        )

    @app.post("/api/tokens", status_code=201)
    def create_token(visitor: Visitor, body: TokenBody) -> Response:
        token = devices.create_token(body.name, visitor.user_name)
        services.close_void_links()
        return json_response({"name": checked_name(body.name), "token": token}, 201)

    @app.post("/api/tokens/revoke")
    def revoke_token(visitor: Visitor, body: TokenBody) -> Response:
        devices.revoke_token(body.name, visitor.user_name)
        for device_id in devices.ids_of(" ".join(body.name.split())):
            services.alerts.forget(device_id)
        services.close_void_links()
        return json_response({"ok": True})


def _add_audit_route(app: FastAPI, services: Services) -> None:
    @app.get("/api/audit")
    def audit(before: Before = None, who: Wanted = "", action: Wanted = "") -> Response:
        # What was done until now is to be seen.
        services.late_audit.write()
        # One more than is shown: whether there are older ones.
        rows = services.store.latest_audit(AUDIT_SHOWN_COUNT + 1, before_id=before, who=who, action=action)
        shown = [
            {"id": r.id, "at_s": r.at_s, "who": r.who, "action": r.action, "detail": r.detail}
            for r in rows[:AUDIT_SHOWN_COUNT]
        ]
        return json_response({"audit": shown, "has_older": len(rows) > AUDIT_SHOWN_COUNT})


def _user_view(user: User) -> dict[str, Any]:
    return {
        "id": user.id,
        "name": user.name,
        "role": user.role,
        "disabled": user.disabled,
        "has_password": user.has_password,
    }
