# SPDX-License-Identifier: Apache-2.0
"""Access to the server: hosts, origins, and the token."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from imu_workbench.web.access import AccessCheck


def answer(token: str, kind: str = 'http', query: str = '', **headers: str) -> list[Any]:
    """What a client sees of a request; the application answers 200."""
    sent: list[Any] = []

    async def application(scope, receive, send) -> None:
        await send({'type': 'http.response.start', 'status': 200, 'headers': []})

    async def send(message) -> None:
        sent.append(message)

    scope = {
        'type': kind,
        'query_string': query.encode(),
        'headers': [(key.encode(), value.encode()) for key, value in headers.items()],
    }
    asyncio.run(AccessCheck(application, token)(scope, None, send))
    return sent


@pytest.mark.parametrize('host', ['localhost:8080', '127.0.0.1:1', '[::1]:8080'])
def test_this_machine_passes(host):
    assert answer('', host=host)[0]['status'] == 200


@pytest.mark.parametrize('host', ['evil.example:8080', '192.168.1.2:8080', ''])
def test_a_foreign_name_does_not(host):
    assert answer('', host=host)[0]['status'] == 403


def test_the_token_opens_once_and_the_cookie_afterwards():
    first = answer('secret', query='token=secret', host='10.0.0.1')[0]
    assert first['status'] == 200
    cookie = dict(first['headers'])[b'set-cookie'].decode()
    assert 'HttpOnly' in cookie
    assert answer('secret', cookie=cookie.partition(';')[0])[0]['status'] == 200


@pytest.mark.parametrize('query', ['', 'token=', 'token=wrong', 'token=secret2'])
def test_without_the_token_nothing_is_answered(query):
    assert answer('secret', query=query, host='localhost')[0]['status'] == 403
    assert answer('secret', 'websocket', query)[0]['type'] == 'websocket.close'


def test_a_page_of_another_server_opens_no_web_socket():
    foreign = answer('', 'websocket', host='localhost:8080', origin='http://evil.example')
    assert foreign[0]['type'] == 'websocket.close'
    own = answer('', host='localhost:8080', origin='http://localhost:8080')
    assert own[0]['status'] == 200


@pytest.mark.parametrize('gone', [True, False])
def test_who_leaves_before_the_answer_is_no_error_of_the_server(gone):
    async def application(scope, receive, send) -> None:
        await receive()
        raise RuntimeError('No response returned.')

    async def receive():
        return {'type': 'http.disconnect' if gone else 'http.request'}

    scope = {'type': 'http', 'headers': [(b'host', b'localhost')]}
    asked = AccessCheck(application)(scope, receive, None)
    if gone:
        asyncio.run(asked)
    else:
        with pytest.raises(RuntimeError, match='No response'):
            asyncio.run(asked)
