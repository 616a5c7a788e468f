"""A vehicle's camera, as far as its clients see: H.264 over RTSP and TCP, a password before it.

RTSP 1.0 (RFC 2326) with interleaved RTP (RFC 3550); H.264 in RTP as single units and in pieces (RFC 6184). Every
picture is a key frame whose samples are sent as they are (ITU-T H.264, 7.3.5: I_PCM).
"""

import base64
import re
import socket
import struct
import threading

import numpy as np

USER = "me:secret"
PIECE = 1400  # of a picture in one packet [bytes]
TYPE = 96  # of the payload
PERIOD = 0.04  # of pictures [s]
AHEAD_OF_SAMPLES = "000011010"  # of each macroblock, as text of bits: mb_type 25, I_PCM


def _ue(value: int) -> str:
    """An unsigned number in the code of Exp-Golomb (H.264, 9.1)."""
    digits = f"{value + 1:b}"
    return "0" * (len(digits) - 1) + digits


def _unit(head: int, payload: bytes) -> bytes:
    """A NAL unit; no start code may appear within it."""
    return bytes([head]) + re.sub(rb"\x00\x00(?=[\x00-\x03])", b"\x00\x00\x03", payload)


def _aligned(bits: str) -> bytes:
    bits += "0" * (-len(bits) % 8)
    return int(bits, 2).to_bytes(len(bits) // 8, "big")


def _sequence(width: int, height: int) -> bytes:
    """The baseline profile, level 4, order of pictures as sent, no references."""
    bits = f"{66:08b}{0xC0:08b}{40:08b}" + _ue(0) + _ue(0) + _ue(2) + _ue(0) + "0"
    return _unit(0x67, _aligned(bits + _ue(width // 16 - 1) + _ue(height // 16 - 1) + "11001"))


def _picture_set() -> bytes:
    """CAVLC, one group of slices, nothing else."""
    return _unit(0x68, _aligned(_ue(0) + _ue(0) + "00" + 3 * _ue(0) + "000" + 3 * _ue(0) + "000" + "1"))


def _key_frame(grey: np.ndarray, number: int) -> bytes:
    """A picture of whole macroblocks, shape (16 m, 16 n), without colour."""
    blocks = grey.reshape(grey.shape[0] // 16, 16, -1, 16).swapaxes(1, 2).reshape(-1, 256)
    samples = [np.clip(block, 16, 235).astype(np.uint8).tobytes() + 128 * b"\x80" for block in blocks]
    head = _aligned(_ue(0) + _ue(7) + _ue(0) + "0000" + _ue(number % 2) + "00" + _ue(0) + AHEAD_OF_SAMPLES)
    return _unit(0x65, head + _aligned(AHEAD_OF_SAMPLES).join(samples) + b"\x80")


def _payloads(unit: bytes) -> list[bytes]:
    """Of RTP for one NAL unit: itself, or its pieces (FU-A)."""
    if len(unit) <= PIECE:
        return [unit]
    pieces = [unit[i : i + PIECE] for i in range(1, len(unit), PIECE)]
    flags = [0x80, *[0] * (len(pieces) - 2), 0x40]
    return [bytes([unit[0] & 0xE0 | 28, flag | unit[0] & 0x1F]) + p for flag, p in zip(flags, pieces, strict=True)]


def _described(width: int, height: int) -> bytes:
    sets = ",".join(base64.b64encode(unit).decode() for unit in (_sequence(width, height), _picture_set()))
    lines = ["v=0", "o=- 0 0 IN IP4 127.0.0.1", "s=film", "t=0 0", f"m=video 0 RTP/AVP {TYPE}"]
    lines += [f"a=rtpmap:{TYPE} H264/90000", f"a=fmtp:{TYPE} packetization-mode=1;sprop-parameter-sets={sets}"]
    return "\r\n".join([*lines, "a=control:track", ""]).encode()


def h264_over_rtsp(caller: socket.socket, grey: np.ndarray, ended: threading.Event) -> None:
    """Answer one client up to PLAY, then send it the picture, shape (16 m, 16 n), until that has `ended`."""
    described = _described(grey.shape[1], grey.shape[0])
    heads = {
        "OPTIONS": "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n",
        "DESCRIBE": f"Content-Type: application/sdp\r\nContent-Length: {len(described)}\r\n",
        "SETUP": "Session: 1\r\nTransport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n",
        "PLAY": "Session: 1\r\n",
    }
    known = "Authorization: Basic " + base64.b64encode(USER.encode()).decode()
    method, received = "", b""
    while method != "PLAY":
        while b"\r\n\r\n" not in received:
            received += (came := caller.recv(4096))
            if not came:
                return
        request, _, received = received.partition(b"\r\n\r\n")
        lines = request.decode().split("\r\n")
        method, count = lines[0].split()[0], next(line for line in lines if line.startswith("CSeq:"))
        if known not in lines:
            method, head, status = "", 'WWW-Authenticate: Basic realm="film"\r\n', "401 Unauthorized"
        else:
            head, status = heads[method], "200 OK"
        body = described if method == "DESCRIBE" else b""
        caller.sendall(f"RTSP/1.0 {status}\r\n{count}\r\n{head}\r\n".encode() + body)
    _play(caller, grey, ended)


def _play(caller: socket.socket, grey: np.ndarray, ended: threading.Event) -> None:
    frames = [_payloads(_key_frame(grey, number)) for number in (0, 1)]
    sent = number = 0
    while not ended.wait(PERIOD):
        payloads = frames[number % 2]
        for k, payload in enumerate(payloads, start=1):
            marked = TYPE | 0x80 * (k == len(payloads))
            head = struct.pack(">BBHII", 0x80, marked, sent % 65536, round(90_000 * PERIOD) * number, 1)
            caller.sendall(struct.pack(">BBH", ord("$"), 0, len(head) + len(payload)) + head + payload)
            sent += 1
        number += 1
