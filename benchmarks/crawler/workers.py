"""Two crawl workers with one Redis: memory against pages, and kills at random moments.

    python -m benchmarks.crawler.workers --products 2500 26000
    python -m benchmarks.crawler.workers --products 300 --kills 10

The synthetic site, the workers and Redis are separate processes. A kill is SIGKILL of worker one, worker two or Redis
in turn, after 0 to 6 s of work of both workers; Redis (`--appendonly yes`) restarts from its disk, and workers that
ended continue with `--resume`. The output states the longest time without a finished page, and the peak memory of each
worker and the memory of Redis after every tenth of the pages (a product has four). Each item of the site must be found
with its size; without kills no page is requested twice. A crawl follows at most 120 consecutive listings, so that it
starts at every hundredth.
"""

from __future__ import annotations

import random
import resource
import subprocess
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import redis

from benchmarks.child import _peak_kib, ours
from benchmarks.common import options_parser
from benchmarks.crawler.crawl import ServedShop, _against_truth
from tests.crawler.conftest import RedisServer
from tests.synthetic.synthetic_site import PRODUCTS_PER_LISTING, Shop

WORKERS = ("one", "two")
#: Maximum time between two kills in seconds.
MAX_WAIT_S = 6.0


def main() -> None:
    """Print a row per number of products."""
    parser = options_parser(__doc__)
    parser.add_argument("--products", type=int, nargs="+", default=[300])
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(
        "products | responses | ms per response | peak MB of a worker | expected | right | missed | doubled | pause s",
        flush=True,
    )
    for products in options.products:
        with tempfile.TemporaryDirectory(prefix="crawl-") as name:
            crawl(Shop(products=products, errors=False), Path(name), options.kills, options.seed)


def crawl(shop: Shop, folder: Path, kills: int, seed: int) -> None:
    """Crawl a shop with two workers, and print its row."""
    generator = random.Random(seed)  # noqa: S311 - moments of kills
    (folder / "redis").mkdir()
    served, server = ServedShop(shop), RedisServer(folder / "redis")
    store = redis.Redis.from_url(server.url, socket_timeout=10)
    n_finished, finished_at, pause_s = None, 0.0, 0.0
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    before_s, peak_kib, done = used.ru_utime + used.ru_stime, 0, 0
    victims = [*WORKERS, "redis"] * (kills // 3 + 1)
    running: dict[str, subprocess.Popen[bytes]] = {}
    ended: set[str] = set()
    next_page = step = 4 * shop.products // 10
    try:
        while len(ended) < len(WORKERS):
            for worker in WORKERS:
                process = running.get(worker)
                if process is not None and process.poll() == 0:
                    ended.add(worker)
                elif process is None or process.poll() is not None:
                    running[worker] = start(shop, served.base, folder, server.url, worker)
            moment = time.monotonic() + generator.uniform(0.0, MAX_WAIT_S)
            while time.monotonic() < moment:
                peak_kib = max([peak_kib, *(_peak_kib(process.pid) for process in running.values())])
                with suppress(redis.RedisError):
                    n_now = store.hget("metric-tree:out:done", "pages")
                    if n_now != n_finished:
                        pause_s = max(pause_s, time.monotonic() - finished_at) if n_finished else 0.0
                        n_finished, finished_at = n_now, time.monotonic()
                    if int(n_now or 0) >= next_page:
                        next_page += step
                        print(f"{int(n_now):,} pages; MB: {memory_of(running, store)}", flush=True)
                time.sleep(0.2)
            if done < kills and not ended:
                kill(victims[done], running, server)
                done += 1
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        counts = served.request_counts()
        cpu_s = used.ru_utime + used.ru_stime - before_s
        truth = _against_truth(shop, folder / "out")
        columns = [shop.products, counts.total(), round(1000 * cpu_s / counts.total(), 1), round(peak_kib / 1024)]
        columns += [truth[name] for name in ("expected", "right", "missed", "doubled")] + [round(pause_s, 1)]
        twice = sum(count - 1 for path, count in counts.items() if path.startswith("/item/"))
        print(" | ".join(map(str, columns)), f"({done} kills; {twice} product pages requested again)", flush=True)
    finally:
        for process in running.values():
            process.kill()
            process.wait()
        server.stop()
        served.close()


def memory_of(running: Mapping[str, subprocess.Popen[bytes]], store: redis.Redis) -> str:
    """Return the peak memory of each worker and the present memory of Redis in MB."""
    sizes = {worker: _peak_kib(process.pid) / 1024 for worker, process in running.items()}
    sizes["redis"] = store.info("memory")["used_memory"] / 2**20
    return ", ".join(f"{name} {size:.0f}" for name, size in sizes.items())


def start(shop: Shop, base: str, folder: Path, address: str, worker: str) -> subprocess.Popen[bytes]:
    """Start a worker, which continues its work of an earlier run."""
    words = ["crawl", "generic", "--out", folder / "out", "--contact", "a@example.org"]
    for listing in range(0, shop.products // PRODUCTS_PER_LISTING + 1, 100):
        words += ["--start-url", f"{base}/list/{listing}"]
    words += ["--delay", 0, "--private", "--json", "--redis", address, "--worker", worker]
    words += ["--resume"] if (folder / "out" / worker / "frontier.sqlite").exists() else []
    with (folder / f"{worker}.log").open("ab") as log:
        return subprocess.Popen(ours("metric-tree", *words), stdout=log, stderr=log)


def kill(victim: str, running: dict[str, subprocess.Popen[bytes]], server: RedisServer) -> None:
    """Kill a process, and start Redis again with the data of its disk."""
    if victim == "redis":
        server.stop(keep=True)
        server.start()
    else:
        running[victim].kill()
        running[victim].wait()


if __name__ == "__main__":
    main()
