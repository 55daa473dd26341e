"""Kill the processes of a build on Dask at random moments: `python -m benchmarks.metric_tree.kills [--kills 10]`.

The raw items (2,000 rows by default) are on an S3 server (moto). Server, Dask scheduler, two Dask workers and client
are separate processes. Each round starts the client, kills one of these at a random moment of a build with SIGKILL, and
starts it again after a second; a client that ended with an error is started again, too. The release must have the bytes
of a build in one process. The server has no disk: after a kill it gets the same raw items again. Needs moto and s3fs.
"""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from benchmarks.common import options_parser
from metric_tree.pipeline.build import build_release
from tests.support.s3_server import free_port, wait_for_port
from tests.support.small_build import OPTIONS
from tests.synthetic.raw_fixture import SOURCES, TYPICAL, synthetic_items, written
from tests.synthetic.small_taxonomy import small_taxonomy

VICTIMS = ("client", "worker 1", "worker 2", "scheduler", "store")
#: Maximum duration of a client in seconds, on a machine with other work, and maximum number of its starts in a round.
LIMIT_S, MAX_STARTS = 1200.0, 6
#: Size of a block in bytes: 2,000 rows are 24 blocks.
BLOCK_BYTES = "40000"
#: Time between a kill and the new start in seconds.
PAUSE_S = 1.0


class Cluster:
    """The processes of a build, by name."""

    def __init__(self, folder: Path, raw: Path) -> None:
        self.folder, self.raw, self.processes = folder, raw, dict[str, subprocess.Popen[bytes]]()
        self.ports = {"store": free_port(), "scheduler": free_port()}
        os.environ |= {
            "AWS_ACCESS_KEY_ID": "id",
            "AWS_SECRET_ACCESS_KEY": "none",
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.ports['store']}",
            "MOTO_PORT": str(self.ports["store"]),
            "OMP_NUM_THREADS": "1",
        }
        self.address = f"tcp://127.0.0.1:{self.ports['scheduler']}"

    def start(self, name: str) -> None:
        """Start a process, which continues in the background."""
        port = str(self.ports.get(name, 0))
        out = self.folder / "release"
        worker = ["distributed.cli.dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        words = {
            "store": ["moto.server", "-H", "127.0.0.1", "-p", port],
            "scheduler": ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"],
            "client": ["tests.support.small_build", "s3://bucket/raw.jsonl", str(out), "", self.address, BLOCK_BYTES],
        }.get(name, [*worker, "--local-directory", str(self.folder / name.replace(" ", "-"))])
        log = (self.folder / f"{name.replace(' ', '-')}.log").open("ab")
        self.processes[name] = subprocess.Popen([sys.executable, "-m", *words], stdout=log, stderr=log)
        if name in self.ports:
            wait_for_port(self.ports[name])
        if name == "store":
            self.fill_store()

    def fill_store(self) -> None:
        """Copy the raw items to the store."""
        import boto3

        client = boto3.client("s3")  # reads the environment
        client.create_bucket(Bucket="bucket")
        client.put_object(Bucket="bucket", Key="raw.jsonl", Body=self.raw.read_bytes())

    def start_missing(self) -> None:
        """Start all processes that have ended, except for the client."""
        for name in ("store", "scheduler", "worker 1", "worker 2"):
            if name not in self.processes or self.processes[name].poll() is not None:
                self.start(name)

    def run_client(self, victim: str | None, moment: float) -> tuple[float, int, bool]:
        """Run the client until it succeeds: seconds, number of starts, and whether the victim was killed before."""
        started, was_killed = time.monotonic(), False
        for n_starts in range(1, MAX_STARTS + 1):
            self.start_missing()
            self.start("client")
            if victim is not None and n_starts == 1:
                time.sleep(moment)
                was_killed = self.processes["client"].poll() is None
                self.processes[victim].kill()
                self.processes[victim].wait()
                time.sleep(PAUSE_S)
                self.start_missing()
            end = time.monotonic() + LIMIT_S
            while self.processes["client"].poll() is None and time.monotonic() < end:
                time.sleep(0.2)
                self.start_missing()  # as a supervisor does: workers end some time after their scheduler
            # a client that was killed after the publication has done its work
            if self.processes["client"].poll() == 0 or (self.folder / "release").exists():
                return time.monotonic() - started, n_starts, was_killed
        raise SystemExit(f"{victim}: no release after {MAX_STARTS} starts; see {self.folder}")

    def close(self) -> None:
        """End all processes."""
        for process in self.processes.values():
            process.kill()
            process.wait()


def main() -> None:
    """Print a row per victim."""
    parser = options_parser(__doc__)
    parser.add_argument("--rows", type=int, default=2_000)
    parser.add_argument("--kills", type=int, default=10, help="number of kills of each process")
    parser.add_argument("--processes", nargs="+", choices=VICTIMS, default=VICTIMS, help="processes that are killed")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    generator = random.Random(options.seed)  # noqa: S311 - moments of kills
    folder = Path(tempfile.mkdtemp(prefix="kills-"))
    raw = written(folder / "raw.jsonl", synthetic_items(options.rows // (len(TYPICAL) - 1)))
    expected = build_release([raw], folder / "expected", OPTIONS, taxonomy=small_taxonomy, declared=SOURCES)
    cluster = Cluster(folder, raw)
    try:
        seconds, _, _ = cluster.run_client(None, 0.0)
        check(folder, expected.release.directory)
        n_rows = sum(1 for _ in raw.open())
        print(f"{n_rows:,} rows, {seconds:.0f} s without a kill, seed {options.seed}", flush=True)
        print("killed | kills | equal bytes | starts of the client | longest s | moments of the kills in s", flush=True)
        for victim in options.processes:
            starts, longest, moments = Counter[int](), 0.0, list[float]()
            while len(moments) < options.kills:
                moment = generator.uniform(0.0, seconds)
                taken, n_starts, was_killed = cluster.run_client(victim, moment)
                check(folder, expected.release.directory)
                if was_killed:
                    longest = max(longest, taken)
                    moments.append(round(moment, 1))
                    starts[n_starts] += 1
            columns = [victim, len(moments), len(moments), dict(sorted(starts.items())), round(longest), moments]
            print(" | ".join(map(str, columns)), flush=True)
    finally:
        cluster.close()
    shutil.rmtree(folder)


def check(folder: Path, expected: Path) -> None:
    """End the program unless the release has the bytes of the expected one; remove it otherwise."""
    release = folder / "release"
    contents = [
        {path.relative_to(root): path.read_bytes() for path in root.rglob("*") if path.is_file()}
        for root in (release, expected)
    ]
    if contents[0] != contents[1]:
        raise SystemExit(f"{release} differs from {expected}")
    shutil.rmtree(release)
    shutil.rmtree(folder / "release.build")


if __name__ == "__main__":
    main()
