"""Keep a middleware on this machine: its sockets hear the loopback interface only.

Told to stay local, both middlewares still bind their UDP sockets to all addresses. Measured: a participant on another
machine that names this one as its peer is answered by Fast DDS in spite of ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, and
steers; Cyclone ignores it. So the sockets that a middleware opened get a filter that drops what did not come in by the
device `lo`. (SO_BINDTODEVICE is no way: Linux counts a packet from here to this machine's own outer address as one of
the outer device, and the middlewares use that address among themselves.)
"""

import ctypes
import os
import socket
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rovtwin.core.errors import LinkError

_SO_ATTACH_FILTER = 26  # of Linux; the module socket does not name it
_DEVICE_OF_PACKET = 0xFFFFF000 + 8  # SKF_AD_OFF + SKF_AD_IFINDEX of linux/filter.h
_TABLES = ("udp", "udp6", "tcp", "tcp6")
_MAPPED, _ONE = "0000000000000000FFFF0000", "00000000000000000000000001000000"  # ::ffff:a.b.c.d, ::1 in /proc/net


@contextmanager
def confined(confine: bool) -> Iterator[None]:
    """Sockets that this process opens within the block receive from the loopback interface only, if `confine`.

    Raises:
        LinkError: They cannot be confined, so others on the network would be let in.
    """
    before = open_sockets() if confine else {}
    yield
    if not confine:
        return
    if not sys.platform.startswith("linux"):
        raise LinkError("ROS 2: only on Linux can it be kept on this machine. Add --expose if others may reach it")
    for inode, handle in open_sockets().items():
        if inode not in before:
            _receive_loopback_only(handle)


def open_sockets() -> dict[str, int]:
    """Internet sockets of this process that are not bound to a loopback address: file descriptors by inode."""
    known = {inode for table in _TABLES for inode in _not_local(Path("/proc/self/net") / table)}
    found = {}
    for entry in Path("/proc/self/fd").iterdir() if known else ():
        try:
            target = os.readlink(entry)
        except OSError:  # closed meanwhile
            continue
        inode = target.removeprefix("socket:[").removesuffix("]")
        if inode in known:
            found[inode] = int(entry.name)
    return found


def _not_local(table: Path) -> Iterator[str]:
    try:
        rows = table.read_text().splitlines()[1:]
    except OSError:
        return
    for row in rows:
        words = row.split()
        address = words[1].partition(":")[0]
        # Words of 32 bits, little-endian: the first byte of an IPv4 address is written last.
        local = address.endswith("7F") if len(address) == 8 or address.startswith(_MAPPED) else address == _ONE
        if not local:
            yield words[9]


def _receive_loopback_only(handle: int) -> None:
    code = ctypes.create_string_buffer(_filter(socket.if_nametoindex("lo")))
    program = struct.pack("@HP", 4, ctypes.addressof(code))
    try:
        with socket.socket(fileno=os.dup(handle)) as copy:
            copy.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, program)
    except OSError as error:
        raise LinkError(
            f"ROS 2: cannot be kept on this machine: a socket takes no filter ({error.strerror}). "
            "Add --expose if others may reach it"
        ) from error


def _filter(device: int) -> bytes:
    """Four instructions of classic BPF: load the number of the device a packet came by, and drop it if another."""
    load, equal, give = 0x20, 0x15, 0x06
    rows = ((load, 0, 0, _DEVICE_OF_PACKET), (equal, 0, 1, device), (give, 0, 0, 0xFFFFFFFF), (give, 0, 0, 0))
    return b"".join(struct.pack("=HBBI", *row) for row in rows)
