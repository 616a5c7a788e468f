"""Who may come in: every door of the server, from this machine and from others, by pages of ours and of others."""

import pytest
from tests.console.loops import ran

pytest.importorskip("starlette", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")

from rovtwin.console.web.gate import COOKIE, Gate, Guard

HOME, AWAY, ELSEWHERE = "127.0.0.1:8800", "192.168.1.7:8800", "elsewhere.example"
TOKEN = "a-token"
DOORS = (("http", "/"), ("http", "/stop"), ("websocket", "/live"), ("websocket", "/_nicegui_ws/socket.io/"))


async def server(scope, receive, send):
    """Lets all in."""
    if scope["type"] == "http":
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"come in"})
    else:
        await receive()
        await send({"type": "websocket.accept"})


def knock(gate, door, host, query="", **headers):
    """Ask at a door; whether one comes in, and the answer's headers."""
    kind, path = door
    lines = {"host": host} | headers
    scope = {"type": kind, "path": path, "query_string": query.encode(), "method": "GET"}
    scope["headers"] = [(key.encode(), value.encode("latin-1")) for key, value in lines.items()]
    sent = []

    async def receive():
        return {"type": "websocket.connect" if kind == "websocket" else "http.request"}

    async def send(message):
        sent.append(message)

    ran(Guard(server, gate)(scope, receive, send))
    first = sent[0]
    if kind == "websocket":
        assert first["type"] in ("websocket.accept", "websocket.close")
        return first["type"] == "websocket.accept", {}
    assert first["status"] in (200, 403)
    return first["status"] == 200, {key.decode(): value.decode() for key, value in first["headers"]}


def open_doors(gate, host, query="", **headers):
    """How many doors are open."""
    return sum(knock(gate, door, host, query, **headers)[0] for door in DOORS)


def test_this_machine_needs_no_token():
    assert open_doors(Gate("127.0.0.1", None), HOME) == len(DOORS)
    assert open_doors(Gate("127.0.0.1", None), HOME, origin=f"http://{HOME}") == len(DOORS)
    assert open_doors(Gate("::1", None), "[::1]:8800") == len(DOORS)
    assert open_doors(Gate("localhost", None), "localhost:8800") == len(DOORS)


@pytest.mark.parametrize("origin", ["https://elsewhere.example", "http://127.0.0.1:9999", "http://127.0.0.1", "null"])
def test_a_page_of_another_site_gets_nothing(origin):
    assert open_doors(Gate("127.0.0.1", None), HOME, origin=origin) == 0


def test_a_name_that_leads_here_from_outside_gets_nothing():
    """DNS rebinding: the page's own host is elsewhere.example, and its address is made to be ours."""
    host = f"{ELSEWHERE}:8800"
    assert open_doors(Gate("127.0.0.1", None), host, origin=f"http://{host}") == 0
    assert open_doors(Gate("127.0.0.1", None), host) == 0
    assert open_doors(Gate("127.0.0.1", None), "") == 0


def test_another_machine_needs_the_token_once_and_then_has_a_cookie():
    gate = Gate("0.0.0.0", TOKEN)
    assert open_doors(gate, AWAY) == 0
    for wrong in ("token=", "token=wrong", "token=%C3%A4", f"other={TOKEN}"):  # one is not ASCII
        assert open_doors(gate, AWAY, wrong) == 0
    came, headers = knock(gate, ("http", "/"), AWAY, f"token={TOKEN}")
    assert came
    cookie, *rules = headers["set-cookie"].split("; ")
    assert {"HttpOnly", "SameSite=strict", "Path=/"} <= set(rules)
    assert open_doors(gate, AWAY, cookie=cookie) == len(DOORS)
    assert open_doors(gate, AWAY, cookie=cookie, origin=f"http://{AWAY}") == len(DOORS)
    assert open_doors(gate, AWAY, cookie=cookie, origin=f"http://{ELSEWHERE}") == 0
    assert "set-cookie" not in knock(gate, ("http", "/"), AWAY, cookie=cookie)[1]


def test_a_wrong_cookie_is_none():
    gate = Gate("0.0.0.0", TOKEN)
    for wrong in ("wrong", "wr\u00f6ng", ""):
        assert open_doors(gate, AWAY, cookie=f"{COOKIE}={wrong}") == 0


def test_no_other_page_may_show_the_console_within_itself():
    _, headers = knock(Gate("127.0.0.1", None), ("http", "/"), HOME)
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
