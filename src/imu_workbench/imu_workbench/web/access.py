# SPDX-License-Identifier: Apache-2.0
"""Access to the server: from this machine alone, or with the token."""

from __future__ import annotations

import hmac
import ipaddress
from functools import partial
from typing import Any
from urllib.parse import parse_qs

COOKIE_NAME = 'imu_workbench_token'
LOCAL_NAMES = ('localhost', '127.0.0.1', '::1')
REFUSED_TOKEN = (
    b'<!doctype html><meta charset="utf-8"><title>IMU workbench</title>'
    b'<p>This server asks for its token: open the address with ?token= that it printed at its '
    b'start.</p>'
)
NO_RESPONSE = 'No response returned.'
"""Message of the error that starlette raises where a request ended before its answer began."""
REFUSED_HOST = b'<!doctype html><p>This server answers to localhost only.</p>'


def is_local(host: str) -> bool:
    """Tell whether an address to bind is this machine's own.

    >>> is_local('127.0.0.1'), is_local('localhost'), is_local('0.0.0.0')
    (True, True, False)
    """
    try:
        return host == 'localhost' or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Listening:
    """Messages of a client; notes when it has disconnected."""

    def __init__(self, receive: Any) -> None:
        self._receive = receive
        self.gone = False

    async def __call__(self) -> Any:
        """Return the next message."""
        message = await self._receive()
        self.gone = self.gone or message['type'] == 'http.disconnect'
        return message


class AccessCheck:
    """ASGI middleware over pages and web sockets alike.

    Without a token only requests that name this machine pass, so that a foreign web page whose
    name resolves to it does not. With a token, the first request carries it and gets a cookie.
    """

    def __init__(self, app: Any, token: str = '') -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass a request on, or refuse it."""
        if scope['type'] not in ('http', 'websocket'):
            await self._app(scope, receive, send)
            return
        receive = Listening(receive)
        try:
            await self._checked(scope, receive, send)
        except RuntimeError as error:
            # The page was closed while it loaded: there is nobody to answer.
            if not receive.gone or str(error) != NO_RESPONSE:
                raise

    async def _checked(self, scope: Any, receive: Any, send: Any) -> None:
        headers = {
            key.decode('latin-1').lower(): value.decode('latin-1')
            for key, value in scope['headers']
        }
        if is_foreign(headers.get('origin', ''), headers.get('host', '')):
            await refuse(scope, send, REFUSED_HOST)
            return
        if not self._token:
            if host_of(headers.get('host', '')) in LOCAL_NAMES:
                await self._app(scope, receive, send)
            else:
                await refuse(scope, send, REFUSED_HOST)
            return
        query = parse_qs(scope.get('query_string', b'').decode('latin-1'))
        given = query.get('token', [''])[0]
        if self._matches(given):
            await self._app(scope, receive, with_cookie(send, given))
        elif self._matches(token_in(headers.get('cookie', ''))):
            await self._app(scope, receive, send)
        else:
            await refuse(scope, send, REFUSED_TOKEN)

    def _matches(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._token.encode())


def host_of(header: str) -> str:
    """Return the host of a Host header without its port.

    >>> host_of('localhost:8080'), host_of('[::1]:8080'), host_of('127.0.0.1')
    ('localhost', '::1', '127.0.0.1')
    """
    if header.startswith('['):
        return header[1:].partition(']')[0]
    return header.partition(':')[0].lower()


def is_foreign(origin: str, host: str) -> bool:
    """Tell whether a request was made by a page of another server.

    >>> is_foreign('http://localhost:8080', 'localhost:8080'), is_foreign('', 'localhost:8080')
    (False, False)
    >>> is_foreign('http://evil.example', 'localhost:8080'), is_foreign('null', 'localhost')
    (True, True)
    """
    return bool(origin) and origin.partition('://')[2] != host


def token_in(header: str) -> str:
    """Return the token of a Cookie header, '' without one; other programs' cookies may be odd.

    >>> token_in('a[]={"x":1}; imu_workbench_token=secret')
    'secret'
    """
    pairs = (part.strip().partition('=') for part in header.split(';'))
    return next((value for name, _, value in pairs if name == COOKIE_NAME), '')


def with_cookie(send: Any, token: str) -> Any:
    """Return `send` that also hands out the cookie."""
    return partial(_send_with_cookie, send, token)


async def _send_with_cookie(send: Any, token: str, message: Any) -> None:
    if message['type'] == 'http.response.start':
        value = f'{COOKIE_NAME}={token}; HttpOnly; SameSite=Strict; Path=/'.encode()
        message = {**message, 'headers': [*message['headers'], (b'set-cookie', value)]}
    await send(message)


async def refuse(scope: Any, send: Any, body: bytes) -> None:
    """Answer 403, or close the web socket."""
    if scope['type'] == 'websocket':
        await send({'type': 'websocket.close', 'code': 4403})
        return
    headers = [(b'content-type', b'text/html; charset=utf-8')]
    await send({'type': 'http.response.start', 'status': 403, 'headers': headers})
    await send({'type': 'http.response.body', 'body': body})
