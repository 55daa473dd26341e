"""Compare the request rate of the explorer with a bare Starlette route, and measure memory after mixed requests.

    python -m benchmarks.explorer_load [--requests 2000] [--mixed 100000]

The server is a separate process; the client sends one request after the other over one connection. The kinds of
requests alternate, so that other load on the machine slows all of them equally.
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

#: Number of rounds over all kinds of requests.
N_ROUNDS = 40

#: Number of categories in the timed queries: the ones with the most items.
N_CATEGORIES = 100

BARE = "bare route"

_JSON = {"content-type": "application/json"}


def main() -> None:
    """Print the rate of each kind of request, then the memory of the server."""
    parser = options_parser(__doc__)
    parser.add_argument("--requests", type=int, default=2000, help="requests of each kind (default: %(default)s)")
    parser.add_argument("--mixed", type=int, default=100_000, help="requests of the memory test (default: %(default)s)")
    arguments = parser.parse_args()
    count, mixed = arguments.requests, arguments.mixed
    use_one_thread()  # as `metric-tree serve` does; the server process inherits the setting
    pipe, server_pipe = multiprocessing.Pipe()
    server = multiprocessing.get_context("spawn").Process(target=serve, args=(server_pipe,))
    server.start()
    try:
        ports = pipe.recv()
        print_rates(ports, count)
        started = time.perf_counter()
        print(f"memory of the server: {resident_mb(server.pid)} MB")
        for done in send_mixed(ports[1], mixed):
            print(f"after {done:,} mixed requests {resident_mb(server.pid)} MB; {time.perf_counter() - started:.0f} s")
        pipe.send("stop")
        server.join(30)
    finally:
        server.terminate()


def print_rates(ports: list[int], count: int) -> None:
    """Print, for each kind, requests per second, median and 99th percentile, and the bare route's median over it."""
    bare, explorer = (HTTPConnection("127.0.0.1", port, timeout=60) for port in ports)
    nodes = sorted(metric_tree.open().leaves(), key=lambda node: -node.n_items)[:N_CATEGORIES]
    chance = random.Random(1)  # noqa: S311 - no secret
    kinds: dict[str, Callable[[], float]] = {
        BARE: lambda: request_seconds(bare, "/"),
        "node, static": lambda: request_seconds(explorer, "/v1/nodes/chair.n.01.json"),
        "node, page": lambda: request_seconds(explorer, "/nodes/chair.n.01.html"),
        "prior, asked before": lambda: request_seconds(explorer, "/v1/nodes/chair.n.01/prior?dims=height"),
        "prior, new": lambda: request_seconds(explorer, new_prior(chance, chance.choice(nodes).node_id)),
        "search, asked before": lambda: request_seconds(explorer, "/v1/search?q=swivel+chair"),
        "search, new": lambda: request_seconds(explorer, new_search(chance, chance.choice(nodes).name)),
        "scale, 50 objects": lambda: request_seconds(explorer, "/v1/scale", json.dumps(fifty_objects(chance))),
    }
    times: dict[str, list[float]] = {name: [] for name in kinds}
    for node in nodes:
        request_seconds(explorer, new_prior(chance, node.node_id))
    for send in kinds.values():
        for _ in range(3):
            send()
    for _ in range(N_ROUNDS):
        for name, send in kinds.items():
            times[name] += [send() for _ in range(max(1, count // N_ROUNDS // (10 if "scale" in name else 1)))]
    for name, seconds in times.items():
        median, late = statistics.median(seconds), statistics.quantiles(seconds, n=100)[98]
        ratio = statistics.median(times[BARE]) / median
        print(
            f"{name:<22}{1 / median:6.0f} per s  median {1e3 * median:6.2f} ms  99 % {1e3 * late:6.2f} ms  {ratio:.2f}"
        )


def send_mixed(port: int, count: int) -> Iterator[int]:
    """Request priors, searches, pages, nodes and items, few of them twice; yield the number sent after each tenth."""
    client, chance = HTTPConnection("127.0.0.1", port, timeout=60), random.Random(2)  # noqa: S311 - no secret
    nodes = [node for node in metric_tree.open() if node.level == 5]
    for index in range(count):
        node = chance.choice(nodes)
        name = slug(node.node_id)
        queries = (new_prior(chance, node.node_id), new_search(chance, node.name))
        kinds = (*queries, f"/nodes/{name}.html", f"/v1/nodes/{name}", f"/v1/nodes/{name}/items")
        request_seconds(client, kinds[index % len(kinds)])
        if (index + 1) % max(1, count // 10) == 0:
            yield index + 1


def new_prior(chance: random.Random, node_id: str) -> str:
    """Return the address of a prior with a random quantile, which is not in the server's cache."""
    return f"/v1/nodes/{slug(node_id)}/prior?quantiles={chance.uniform(0.01, 0.99):.6f}"


def new_search(chance: random.Random, name: str) -> str:
    """Return the address of a search for a name without one of its letters."""
    index = chance.randrange(len(name))
    return f"/v1/search?q={quote(name[:index] + name[index + 1 :] or name)}"


def fifty_objects(chance: random.Random) -> dict[str, object]:
    """Return fifty_objects objects of ten categories in a scene with a unit of about 2 m."""
    heights = {"chair": 880, "mug": 95, "bottle": 260, "door": 2050, "car": 1500, "bicycle": 1050, "person": 1700}
    heights |= {"desk": 740, "wardrobe": 1950, "sofa": 850}
    objects = [
        {"id": f"{name} {k}", "category": name, "dimensions": {"height": mm / 2000 * chance.uniform(0.93, 1.07)}}
        for k in range(5)
        for name, mm in heights.items()
    ]
    return {"schema": "metric-tree/objects/1", "objects": objects}


def request_seconds(client: HTTPConnection, address: str, body: str | None = None) -> float:
    """Send a request and return its duration in seconds."""
    started = time.perf_counter()
    client.request("GET" if body is None else "POST", address, body, {} if body is None else _JSON)
    response = client.getresponse()
    content = response.read()
    if response.status != 200:
        raise RuntimeError(f"{address}: {response.status} {content[:300]!r}")
    return time.perf_counter() - started


def resident_mb(pid: int | None) -> int:
    """Return the resident memory of a process in MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) // 1000


def serve(pipe: Connection) -> None:
    """Serve a bare route and the shipped release on two ports until a message arrives in the pipe."""
    import threading

    import uvicorn
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.routing import Route

    from explorer.server.app import application

    async def constant(_: Request) -> Response:
        return Response(b"{}" * 1000, media_type="application/json")

    bare = Starlette(routes=[Route("/", constant)])
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
