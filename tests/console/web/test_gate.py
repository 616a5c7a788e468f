"""Who may come in: every door of the server, from this machine and from others, by pages of ours and of others."""

import asyncio
import http.server
import socket
import threading
import time
from contextlib import contextmanager

import pytest
from tests.console.loops import ran

pytest.importorskip("starlette", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")

from rovtwin.console.web.gate import Gate, Guard, cookie_of

HOME, AWAY, ELSEWHERE = "127.0.0.1:8800", "192.168.1.7:8800", "elsewhere.example"
TOKEN = "a-token"
DOORS = (("http", "/"), ("http", "/stop"), ("websocket", "/live"), ("websocket", "/_nicegui_ws/socket.io/"))


async def server(scope, receive, send):
    """Lets all in."""
    if scope["type"] == "http":
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})
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
        assert open_doors(gate, AWAY, cookie=f"{cookie_of(AWAY)}={wrong}") == 0


def test_no_other_page_may_show_the_console_within_itself():
    _, headers = knock(Gate("127.0.0.1", None), ("http", "/"), HOME)
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["referrer-policy"] == "no-referrer"


def test_consoles_at_two_ports_of_a_machine_have_a_cookie_each():
    """Cookies know no ports: the second would take the first one's away."""
    names = {cookie_of(host) for host in (AWAY, "192.168.1.7:8801", "[::1]:8802", "192.168.1.7")}
    assert len(names) == 4 and not any(set(name) & set(":;=[] ") for name in names)


@pytest.mark.parametrize(
    "query, rest", [("", ""), ("&run=a%20b%26", "?run=a+b%26"), ("&run=%22%3E%3Cscript%3E", "?run=%22%3E%3Cscript%3E")]
)
def test_the_token_is_left_behind_by_a_browser_and_by_no_program(query, rest):
    gate, door = Gate("0.0.0.0", TOKEN), ("http", "/replay")
    for accept in ("*/*", "application/yaml"):  # a program that asks for a file gets it
        assert body(gate, door, f"token={TOKEN}{query}", accept) == "come in"
    page = body(gate, door, f"token={TOKEN}{query}", "text/html,*/*;q=0.8")
    assert f'url=/replay{rest}"' in page and TOKEN not in page
    assert 'url=/elsewhere.example/"' in body(gate, ("http", "//elsewhere.example/"), f"token={TOKEN}", "text/html")
    assert "come in" not in body(gate, door, f"token=wrong{query}", "text/html")


def body(gate, door, query, accept):
    """What is answered to a request."""
    scope = {"type": door[0], "path": door[1], "query_string": query.encode(), "method": "GET"}
    scope["headers"] = [(b"host", AWAY.encode()), (b"accept", accept.encode())]
    sent = []

    async def receive():
        return {"type": "http.request"}

    async def send(message):
        sent.append(message)

    ran(Guard(server, gate)(scope, receive, send))
    return b"".join(message.get("body", b"") for message in sent).decode()


PAGE = b"""<!doctype html><title>console</title><link rel="icon" href="data:,"><script>
fetch('/stop', {method: 'POST'}).then(answer => { window.stop_answered = answer.status; });
new WebSocket(`ws://${location.host}/live`).onopen = () => { window.live_opened = true; };
</script>"""


async def console(scope, receive, send):
    """A page that does what the console's does: STOP by a request, and a socket."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        await receive()
    elif scope["type"] == "http":
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})
        await send({"type": "http.response.body", "body": PAGE if scope["path"] == "/" else b""})


@contextmanager
def guarded():
    """The page behind a guard with a token, at a free port."""
    uvicorn = pytest.importorskip("uvicorn")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    guard = Guard(console, Gate("0.0.0.0", TOKEN))
    config = uvicorn.Config(guard, port=port, lifespan="off", log_level="error", ws="wsproto")
    serving = uvicorn.Server(config)
    thread = threading.Thread(target=lambda: asyncio.run(serving.serve()), daemon=True)
    thread.start()
    while not serving.started:
        time.sleep(0.01)
    yield port
    serving.should_exit = True
    thread.join(5.0)


class Elsewhere(http.server.BaseHTTPRequestHandler):
    """A page of another site with a link to the console, as a chat in the browser has one."""

    link = ""

    def do_GET(self):
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(f'<!doctype html><a href="{self.link}">console</a>'.encode())

    def log_message(self, *_):
        pass


@contextmanager
def elsewhere(link):
    """Its address; another host than the console's, and so another site."""
    other = http.server.ThreadingHTTPServer(("127.0.0.1", 0), type("Linking", (Elsewhere,), {"link": link}))
    threading.Thread(target=other.serve_forever, daemon=True).start()
    yield f"http://localhost:{other.server_port}/"
    other.shutdown()


@pytest.mark.parametrize("come_by", ["typing", "a link on another site"])
def test_in_a_browser_the_token_leaves_the_address_and_everything_works(browser, come_by):
    with guarded() as port:
        context = browser.new_context()
        page, clean = context.new_page(), f"http://127.0.0.1:{port}/"
        page.set_default_timeout(15_000)
        asked = []
        page.on("request", lambda request: asked.append((request.url, request.headers.get("referer", ""))))
        with elsewhere(f"{clean}?token={TOKEN}") as other:
            if come_by == "typing":
                page.goto(f"{clean}?token={TOKEN}")
            else:
                page.goto(other)
                page.click("a")
            page.wait_for_url(clean)
        page.wait_for_function("() => window.stop_answered === 200 && window.live_opened")
        assert not any(TOKEN in referer for _, referer in asked)
        cookies = context.cookies()
        assert [(one["httpOnly"], one["sameSite"]) for one in cookies] == [(True, "Strict")]
        page.reload()
        page.wait_for_function("() => window.stop_answered === 200 && window.live_opened")
        page.go_back()
        assert TOKEN not in page.url
        stranger = browser.new_context().new_page()
        assert stranger.goto(clean).status == 403
        stranger.context.close()
        context.close()
