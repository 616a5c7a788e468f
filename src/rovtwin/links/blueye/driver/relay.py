"""A drone at an address of one's choice: passes on what comes for its ports, and what it answers.

Two drones as delivered have the same address, 192.168.1.101. Each gets a network namespace with its own cable, and in
there a relay that makes it reachable under another address: see docs/links_blueye.md. It needs nothing but Python.

    python -m rovtwin.links.blueye.driver.relay 10.71.1.2 192.168.1.101
"""

import asyncio
import sys
from collections.abc import Awaitable, Callable, Sequence

from rovtwin.core.errors import LinkError
from rovtwin.links.servers.server import address_taken

PORTS = (80, 5555, 5556, 5557, 8554)  # HTTP, telemetry, requests, control, RTSP (its TCP part)
CHUNK = 65536  # bytes passed on at a time
PATIENCE = 3.0  # for the drone to take a connection [s]


async def relay(here: str, drone: str, ports: Sequence[int] = PORTS) -> None:
    """Pass on until cancelled.

    Args:
        here: Address to listen at.
        drone: Address of the drone.
        ports: Passed on, each to the same.

    Raises:
        LinkError: A port cannot be bound.
    """
    servers: list[asyncio.Server] = []
    connections: set[asyncio.Task[None]] = set()
    try:
        for port in ports:
            try:
                servers.append(await asyncio.start_server(_to(drone, port, connections), here, port))
            except OSError as error:
                raise LinkError(address_taken(f"{here}:{port}", error)) from None
        await asyncio.get_running_loop().create_future()
    finally:
        for server in servers:
            server.close()
        for connection in connections:
            connection.cancel()
        await asyncio.gather(*connections, return_exceptions=True)


def _to(
    drone: str, port: int, connections: set[asyncio.Task[None]]
) -> Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers, passing = [writer], []
        task = asyncio.current_task()
        assert task is not None
        connections.add(task)
        try:
            async with asyncio.timeout(PATIENCE):
                back, forth = await asyncio.open_connection(drone, port)
            writers.append(forth)
            passing = [asyncio.ensure_future(_pass_on(*way)) for way in ((reader, forth), (back, writer))]
            # Either side that closes closes both: ZeroMQ connects again by itself.
            await asyncio.wait(passing, return_when=asyncio.FIRST_COMPLETED)
        except (OSError, TimeoutError):
            pass  # the drone is not there
        finally:
            connections.discard(task)
            for way in passing:
                way.cancel()
            for one in writers:
                one.close()

    return serve


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    try:
        while content := await reader.read(CHUNK):
            writer.write(content)
            await writer.drain()
    except OSError:
        pass  # one of them went away


def main(arguments: Sequence[str]) -> int:
    """Command line: address to listen at, address of the drone."""
    if len(arguments) != 2:
        print("usage: python -m rovtwin.links.blueye.driver.relay LISTEN_ADDRESS DRONE_ADDRESS", file=sys.stderr)
        return 2
    try:
        asyncio.run(relay(arguments[0], arguments[1]))
    except LinkError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
