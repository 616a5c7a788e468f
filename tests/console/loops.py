"""Event loops for tests: in a thread of their own, since Playwright's may run in this one."""

import asyncio
from concurrent.futures import ThreadPoolExecutor


def ran(work):
    """What a coroutine returns."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()
