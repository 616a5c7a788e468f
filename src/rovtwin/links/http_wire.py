"""HTTP/1.1 as small as instruments need it: heads of requests and whole responses, bytes in and dataclass out.

Pure functions; no exception but LinkError; everything has a largest size.
"""

import json
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote_to_bytes, urlsplit

from rovtwin.core.errors import LinkError

LONGEST_HEAD = 16 * 1024  # bytes
LONGEST_BODY = 64 * 1024  # bytes
MOST_HEADERS = 64
REASONS = {200: "OK", 400: "Bad Request", 404: "Not Found", 405: "Method Not Allowed", 411: "Length Required"}
REASONS |= {413: "Content Too Large", 500: "Internal Server Error", 503: "Service Unavailable"}


@dataclass(frozen=True)
class Request:
    """The head of a request: method, path without its query, headers by lower-case name, and how much body follows."""

    method: str
    path: str
    headers: dict[str, str] = field(default_factory=dict)
    length: int = 0
    keep: bool = True


@dataclass(frozen=True)
class Response:
    """Status and body of a response."""

    status: int
    body: bytes = b""


def parse_request(head: bytes) -> Request:
    """The head of a request, up to and with its empty line.

    Raises:
        LinkError: It is none that is served here.
    """
    first, headers = _head(head)
    words = first.split(" ")
    if len(words) != 3 or not words[2].startswith("HTTP/1."):
        raise LinkError("expected a line such as GET /path HTTP/1.1")
    try:
        path = unquote_to_bytes(urlsplit(words[1]).path).decode("ascii")
    except ValueError:
        raise LinkError("path: expected plain ASCII") from None
    if "transfer-encoding" in headers:
        raise LinkError("transfer-encoding: expected a body of a stated Content-Length")
    connection = headers.get("connection", "").lower()
    keep = connection == "keep-alive" if words[2] == "HTTP/1.0" else connection != "close"
    return Request(words[0].upper(), path, headers, _length(headers), keep)


def parse_response(data: bytes, ended: bool) -> Response | None:
    """A response from what has come so far; None while it is not whole.

    Args:
        data: All bytes since the request.
        ended: Whether the connection has been closed, which ends a body of unstated length.

    Raises:
        LinkError: It is no response, or too long.
    """
    end = data.find(b"\r\n\r\n")
    if end < 0:
        if ended or len(data) > LONGEST_HEAD:
            raise LinkError("no head of a response")
        return None
    first, headers = _head(data[: end + 4])
    words = first.split(" ", 2)
    if len(words) < 2 or not words[0].startswith("HTTP/1.") or not (words[1].isdecimal() and len(words[1]) == 3):
        raise LinkError("expected a line such as HTTP/1.1 200 OK")
    if "chunked" in headers.get("transfer-encoding", "").lower():
        raise LinkError("a body in chunks, which was not asked for (HTTP/1.0)")
    body = data[end + 4 :]
    if "content-length" in headers:
        length = _length(headers)
        if len(body) >= length:
            return Response(int(words[1]), body[:length])
        if ended:
            raise LinkError(f"body of {len(body)} bytes; {length} were announced")
        return None
    if len(body) > LONGEST_BODY:
        raise LinkError(f"body of more than {LONGEST_BODY} bytes")
    return Response(int(words[1]), body) if ended else None


def request_bytes(method: str, host: str, path: str, body: Any = None) -> bytes:
    """A request whose connection ends with its response; `body` becomes JSON."""
    content = b"" if body is None else json.dumps(body, allow_nan=False).encode()
    kind = f"Content-Type: application/json\r\nContent-Length: {len(content)}\r\n" if body is not None else ""
    head = f"{method} {path} HTTP/1.0\r\nHost: {host}\r\nAccept: application/json\r\n{kind}Connection: close\r\n\r\n"
    return head.encode() + content


def response_bytes(status: int, body: Any, keep: bool) -> bytes:
    """A response with a JSON body."""
    content = json.dumps(body, allow_nan=False).encode()
    head = (
        f"HTTP/1.1 {status} {REASONS.get(status, 'Unknown')}\r\nContent-Type: application/json\r\n"
        f"Content-Length: {len(content)}\r\n"
        f"Connection: {'keep-alive' if keep else 'close'}\r\n\r\n"
    )
    return head.encode() + content


def _head(head: bytes) -> tuple[str, dict[str, str]]:
    if len(head) > LONGEST_HEAD:
        raise LinkError(f"head of more than {LONGEST_HEAD} bytes")
    first, *lines = head.decode("latin-1").split("\r\n")
    headers: dict[str, str] = {}
    for count, line in enumerate(lines):
        if not line:
            break
        name, colon, value = line.partition(":")
        if not colon or count >= MOST_HEADERS:
            raise LinkError(f"expected at most {MOST_HEADERS} headers of the form name: value")
        headers[name.strip().lower()] = value.strip()
    return first, headers


def _length(headers: dict[str, str]) -> int:
    text = headers.get("content-length", "0")
    if not (text.isascii() and text.isdecimal() and len(text) <= 10) or int(text) > LONGEST_BODY:
        raise LinkError(f"content-length: expected a number of at most {LONGEST_BODY}")
    return int(text)
