"""`metric-tree validate DIR`: check all rules of a release."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

from metric_cli.errors import INPUT_ERROR
from metric_cli.tables import print_result
from metric_tree.checks.release_files import CODES, findings
from metric_tree.release.registry import release_directory

HELP = "Check all rules of a release and print the findings with their codes; exit 2 if one is an error (E)."

#: Maximum number of printed findings of one code without `--all`.
MAX_FINDINGS = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("release", metavar="DIR", nargs="?", help="folder or version of a release (default: shipped)")
    parser.add_argument("--codes", action="store_true", help="list the codes with their meanings")
    parser.add_argument("--all", action="store_true", help=f"print all findings, not only {MAX_FINDINGS} of each code")


def run(arguments: argparse.Namespace) -> int:
    """Print the findings; 2 if any is an error."""
    if arguments.codes:
        print_result(arguments.json, CODES, ["code", "meaning"], sorted(CODES.items()))
        return 0
    directory = Path(arguments.release) if arguments.release else release_directory()
    if not directory.is_dir():
        directory = release_directory(arguments.release)
    all_findings = findings(directory)
    shown: Counter[str] = Counter()
    rows = []
    for finding in all_findings:
        shown[finding.code] += 1
        if arguments.all or shown[finding.code] <= MAX_FINDINGS:
            rows.append((finding.code, finding.subject, finding.message))
    counts = ", ".join(f"{code} {count}" for code, count in sorted(shown.items())) or "nothing found"
    records = [{"code": f.code, "subject": f.subject, "message": f.message} for f in all_findings]
    print_result(arguments.json, records, ["code", "subject", "finding"], rows, f"{directory}: {counts}")
    return INPUT_ERROR if any(finding.is_error for finding in all_findings) else 0
