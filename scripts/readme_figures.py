#!/usr/bin/env python3
"""Writes the table between README's marks from the summaries of the committed runs: `scripts/readme_figures.py`."""
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RUNS = {"llvmpipe, small sizes": "llvmpipe", "NVIDIA H100, published sizes": "nvidia-h100"}
# Label, and where the figure stands in a summary.
ROWS = [
    ("verdict on the run", r"^\W*((?:quiet|noisy|drifting)[^\n`|;]*)"),
    ("claims of the papers", r"claims of the papers\W+(\d[^\n|]*?of \d+)"),
    ("own hypotheses", r"own hypotheses\W+(\d[^\n|]*?of \d+)"),
    ("exponent of `godrays/lines` over photons", r"\| godrays/lines \| godray photons \| ([^|]+?) \|"),
    ("exponent of `caustics/trace` over photons", r"\| caustics/trace \| caustic photons \| ([^|]+?) \|"),
]


def figure(summary, pattern):
    found = re.search(pattern, summary, re.MULTILINE)
    return found[1].strip() if found else "–"


def table():
    summaries = [(ROOT / "reports" / name / "summary.md").read_text() for name in RUNS.values()]
    heads = [f"[{label}](reports/{name}/summary.md)" for label, name in RUNS.items()]
    rows = [["", *heads], ["---"] * (1 + len(RUNS))]
    rows += [[label, *(figure(summary, pattern) for summary in summaries)] for label, pattern in ROWS]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


readme = ROOT / "README.md"
begin, end = "<!-- figures -->\n", "<!-- end of figures -->"
before, rest = readme.read_text().split(begin)
readme.write_text(before + begin + "\n" + table() + "\n" + end + rest.split(end)[1])
