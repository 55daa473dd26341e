"""Requests per second of the explorer beside a bare Starlette route, in one run, and memory after mixed requests.

python -m benchmarks.explorer_load [REQUESTS]
"""

from __future__ import annotations

import json
import resource
import sys
import threading
import time
from typing import Any

import httpx
import uvicorn
from starlette.applications import Starlette
from starlette.responses import Response
from starlette.routing import Route

import metric_tree
from explorer.server.application import application

#: Requests of each kind where no number is given.
REQUESTS = 1000

PATHS = {
    "bare route": "/bare",
    "node, static": "/v1/nodes/chair.n.01.json",
    "node page": "/nodes/chair.n.01.html",
    "search": "/v1/search?q=swivel+chair",
    "prior, asked before": "/v1/nodes/chair.n.01/prior?dims=height",
}


def main() -> None:
    """Print a line for each kind."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else REQUESTS
    tree = metric_tree.open()
    bare = Starlette(routes=[Route("/bare", lambda _: Response(b"{}" * 1000, media_type="application/json"))])
    ports = {name: serve(app) for name, app in (("bare", bare), ("explorer", application([tree])))}
    with httpx.Client() as client:
        for name, path in PATHS.items():
            address = f"http://127.0.0.1:{ports['bare' if path == '/bare' else 'explorer']}{path}"
            client.get(address)
            times = sorted(spent(client, address) for _ in range(count))
            rate, middle, late = count / sum(times), times[count // 2], times[int(count * 0.99)]
            print(f"{name:<22}{rate:8.0f} per s   median {1e3 * middle:6.2f} ms   99 % {1e3 * late:6.2f} ms")
        base = f"http://127.0.0.1:{ports['explorer']}"
        objects = [{"id": str(k), "category": "chair", "dimensions": {"height": 0.4 + 0.001 * k}} for k in range(50)]
        body = {"schema": "metric-tree/objects/1", "objects": objects}
        client.post(f"{base}/v1/scale", json=body, timeout=120)
        times = sorted(spent(client, f"{base}/v1/scale", body) for _ in range(10))
        print(f"scale of 50 objects   median {1e3 * times[5]:.0f} ms")
        nodes = [node.node_id for node in tree][:count]
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for place, node_id in enumerate(nodes):
            client.get(f"{base}/v1/nodes/{node_id}{('', '/prior?dims=length', '/items')[place % 3]}")
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"memory: {before / 1024:.0f} MB, after {len(nodes):,} different requests {after / 1024:.0f} MB")


def spent(client: httpx.Client, address: str, body: dict[str, Any] | None = None) -> float:
    """Seconds of one request."""
    started = time.perf_counter()
    answer = client.get(address) if body is None else client.post(address, content=json.dumps(body), headers=_JSON)
    assert answer.status_code == 200, answer.text
    return time.perf_counter() - started


def serve(app: Any) -> int:
    """Serve an application in a thread; its port."""
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="error"))
    threading.Thread(target=server.run, daemon=True).start()
    while not server.started:
        time.sleep(0.01)
    port: int = server.servers[0].sockets[0].getsockname()[1]
    return port


_JSON = {"content-type": "application/json"}

if __name__ == "__main__":
    main()
