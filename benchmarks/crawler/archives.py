"""Cost of a web archive: `metric-tree extract FILE.warc.gz` on product pages and on pages without a size.

The pages are those of `tests/crawler/page/shops`, and the same pages without digits, padded with text to `--kilobytes`.
"""

from __future__ import annotations

import gzip
import json
import re
import tempfile
from itertools import cycle, islice
from pathlib import Path

from benchmarks.child import ours, run_child
from benchmarks.common import options_parser

SHOPS = Path(__file__).parents[2] / "tests" / "crawler" / "page" / "shops"


def write_archive(path: Path, bodies: list[bytes], n_pages: int, n_bytes: int) -> None:
    """Write a WARC file with a gzip member for each response; the pages are repeated and padded."""
    with path.open("wb") as file:
        for number, body in enumerate(islice(cycle(bodies), n_pages)):
            text = body + b"<p>" + b"Some words without meaning. " * max(0, (n_bytes - len(body)) // 28) + b"</p>"
            content = b"HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\n\r\n" + text
            head = f"WARC/1.0\r\nWARC-Type: response\r\nWARC-Target-URI: https://shop.example/{number}\r\n"
            head += f"WARC-Date: 2026-01-02T03:04:05Z\r\nContent-Length: {len(content)}\r\n\r\n"
            file.write(gzip.compress(head.encode() + content + b"\r\n\r\n", 6))


def main() -> None:
    """Print the output of `extract` for both kinds of pages."""
    parser = options_parser(__doc__)
    parser.add_argument("--pages", type=int, default=1000, help="pages of each kind (default: %(default)s)")
    parser.add_argument("--kilobytes", type=int, default=100, help="size of a page (default: %(default)s)")
    options = parser.parse_args()
    shops = [path.read_bytes() for path in sorted(SHOPS.glob("*.html"))]
    without = [re.sub(rb"[0-9]", b"", body) for body in shops]
    with tempfile.TemporaryDirectory() as folder:
        for name, bodies in (("product pages", shops), ("pages without a size", without)):
            path = Path(folder) / "pages.warc.gz"
            write_archive(path, bodies, options.pages, options.kilobytes * 1000)
            items = Path(folder) / "items.jsonl"
            done = run_child(ours("metric-tree", "extract", path, "--out", items, "--overwrite", "--json"))
            print(name, f"{path.stat().st_size / 1e6:.1f} MB, peak {done.peak_mib:.0f} MiB", json.loads(done.output))


if __name__ == "__main__":
    main()
