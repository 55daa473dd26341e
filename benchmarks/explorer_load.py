"""Requests per second of the explorer beside a bare Starlette route, in one run, and memory after mixed requests.

    python -m benchmarks.explorer_load [--requests 2000] [--mixed 100000]

The server is a process of its own; the client asks one request after the other over one connection. The kinds take
turns, so that a busy machine is as slow for one as for the other.
"""

from __future__ import annotations

import json
import multiprocessing
import random
import statistics
import time
from collections.abc import Callable, Iterator
from http.client import HTTPConnection
from multiprocessing.connection import Connection
from pathlib import Path
from urllib.parse import quote

import metric_tree
from benchmarks.common import options_parser
from explorer.urls import slug
from metric_cli.programs import use_one_thread

#: Turns that each kind has.
TURNS = 40

#: Categories of the questions whose rate is measured: those with most items.
EVERYDAY = 100

BARE = "bare route"

_JSON = {"content-type": "application/json"}


def main() -> None:
    """Print a line for each kind, then the memory."""
    parser = options_parser(__doc__)
    parser.add_argument("--requests", type=int, default=2000, help="requests of each kind (2000)")
    parser.add_argument("--mixed", type=int, default=100_000, help="mixed requests of the test of memory (100000)")
    arguments = parser.parse_args()
    count, mixed = arguments.requests, arguments.mixed
    use_one_thread()  # as `metric-tree serve` does; the server's process inherits it
    here, there = multiprocessing.Pipe()
    server = multiprocessing.get_context("spawn").Process(target=serve, args=(there,))
    server.start()
    try:
        ports = here.recv()
        print_rates(ports, count)
        started = time.perf_counter()
        print(f"memory of the server: {resident_mb(server.pid)} MB")
        for done in ask_mixed(ports[1], mixed):
            print(f"after {done:,} mixed requests {resident_mb(server.pid)} MB; {time.perf_counter() - started:.0f} s")
        here.send("stop")
        server.join(30)
    finally:
        server.terminate()


def print_rates(ports: list[int], count: int) -> None:
    """A line for each kind: requests per second, median and 99 %, and the bare route's median over it."""
    bare, explorer = (HTTPConnection("127.0.0.1", port, timeout=60) for port in ports)
    nodes = sorted(metric_tree.open().leaves(), key=lambda node: -node.n_items)[:EVERYDAY]
    chance = random.Random(1)  # noqa: S311 - no secret
    kinds: dict[str, Callable[[], float]] = {
        BARE: lambda: spent(bare, "/"),
        "node, static": lambda: spent(explorer, "/v1/nodes/chair.n.01.json"),
        "node, page": lambda: spent(explorer, "/nodes/chair.n.01.html"),
        "prior, asked before": lambda: spent(explorer, "/v1/nodes/chair.n.01/prior?dims=height"),
        "prior, new": lambda: spent(explorer, new_prior(chance, chance.choice(nodes).node_id)),
        "search, asked before": lambda: spent(explorer, "/v1/search?q=swivel+chair"),
        "search, new": lambda: spent(explorer, new_search(chance, chance.choice(nodes).name)),
        "scale, 50 objects": lambda: spent(explorer, "/v1/scale", json.dumps(fifty(chance))),
    }
    times: dict[str, list[float]] = {name: [] for name in kinds}
    for node in nodes:
        spent(explorer, new_prior(chance, node.node_id))
    for ask in kinds.values():
        for _ in range(3):
            ask()
    for _ in range(TURNS):
        for name, ask in kinds.items():
            times[name] += [ask() for _ in range(max(1, count // TURNS // (10 if "scale" in name else 1)))]
    for name, own in times.items():
        middle, late = statistics.median(own), statistics.quantiles(own, n=100)[98]
        share = statistics.median(times[BARE]) / middle
        print(
            f"{name:<22}{1 / middle:6.0f} per s  median {1e3 * middle:6.2f} ms  99 % {1e3 * late:6.2f} ms  {share:.2f}"
        )


def ask_mixed(port: int, count: int) -> Iterator[int]:
    """Priors, searches, pages, nodes and items, hardly any of them twice; how many are done after each tenth."""
    client, chance = HTTPConnection("127.0.0.1", port, timeout=60), random.Random(2)  # noqa: S311 - no secret
    nodes = [node for node in metric_tree.open() if node.level == 5]
    for place in range(count):
        node = chance.choice(nodes)
        own = slug(node.node_id)
        asked = (new_prior(chance, node.node_id), new_search(chance, node.name))
        kinds = (*asked, f"/nodes/{own}.html", f"/v1/nodes/{own}", f"/v1/nodes/{own}/items")
        spent(client, kinds[place % len(kinds)])
        if (place + 1) % max(1, count // 10) == 0:
            yield place + 1


def new_prior(chance: random.Random, node_id: str) -> str:
    """A question for a quantile that nobody asked before."""
    return f"/v1/nodes/{slug(node_id)}/prior?quantiles={chance.uniform(0.01, 0.99):.6f}"


def new_search(chance: random.Random, name: str) -> str:
    """A name of which a letter is missing."""
    place = chance.randrange(len(name))
    return f"/v1/search?q={quote(name[:place] + name[place + 1 :] or name)}"


def fifty(chance: random.Random) -> dict[str, object]:
    """Fifty objects of ten categories in a scene whose unit is some 2 m."""
    heights = {"chair": 880, "mug": 95, "bottle": 260, "door": 2050, "car": 1500, "bicycle": 1050, "person": 1700}
    heights |= {"desk": 740, "wardrobe": 1950, "sofa": 850}
    objects = [
        {"id": f"{name} {k}", "category": name, "dimensions": {"height": mm / 2000 * chance.uniform(0.93, 1.07)}}
        for k in range(5)
        for name, mm in heights.items()
    ]
    return {"schema": "metric-tree/objects/1", "objects": objects}


def spent(client: HTTPConnection, address: str, body: str | None = None) -> float:
    """Seconds of one request."""
    started = time.perf_counter()
    client.request("GET" if body is None else "POST", address, body, {} if body is None else _JSON)
    answer = client.getresponse()
    content = answer.read()
    if answer.status != 200:
        raise RuntimeError(f"{address}: {answer.status} {content[:300]!r}")
    return time.perf_counter() - started


def resident_mb(pid: int | None) -> int:
    """Resident memory of a process in MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) // 1000


def serve(pipe: Connection) -> None:
    """Serve a bare route and the shipped release on two ports; stop when asked."""
    import threading

    import uvicorn
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.routing import Route

    from explorer.server.app import application

    async def nothing(_: Request) -> Response:
        return Response(b"{}" * 1000, media_type="application/json")

    bare = Starlette(routes=[Route("/", nothing)])
    servers = [
        uvicorn.Server(uvicorn.Config(app, port=0, log_level="error", access_log=False, timeout_keep_alive=600))
        for app in (bare, application([metric_tree.open()], preload=True))
    ]
    for server in servers:
        threading.Thread(target=server.run, daemon=True).start()
    while not all(server.started for server in servers):
        time.sleep(0.01)
    pipe.send([server.servers[0].sockets[0].getsockname()[1] for server in servers])
    pipe.recv()
    for server in servers:
        server.should_exit = True
    time.sleep(1)


if __name__ == "__main__":
    main()
