"""cells.csv of a run and of a sweep, joined by pandas and by polars as docs/exporters.md says: both give each cell the sums that the rows
of its own file have, which `src/report/cells_csv.rs` holds against the records. Argument: the program."""

import csv
import math
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "target" / "python"))
import pandas
import polars

BUDGET = ["--budget", "25s", "--visits", "1"]
COMMANDS = {
    "run": ["run", "uw-default", "vao-pixels", "--no-ceilings", *BUDGET],
    "sweep": ["sweep", "hsao", "--scene", "tank", "--axis", "view=64x48,96x72", *BUDGET],
}
# Of stages, of gaps, and of the frame, which stands in one row.
SUMMED = ["median_ns", "frame_in_no_stage_ns", "frame_untimed_median_ns"]


def check(library, groups, cells, files):
    """Groups by commit and machine, and the sums of each cell by its experiment and name."""
    assert groups == 1, f"{library}: {groups} commits and machines, of one program"
    expected = {}
    for file in files:
        for row in csv.DictReader(file.open(newline="")):
            sums = expected.setdefault((row["experiment"], row["cell"]), [0.0] * len(SUMMED))
            for place, name in enumerate(SUMMED):
                sums[place] += float(row[name] or 0)
    assert len(expected) >= 4 and cells.keys() == expected.keys(), f"{library}: {cells.keys()}"
    for cell, sums in expected.items():
        close = all(math.isclose(a, b, rel_tol=1e-9) for a, b in zip(sums, cells[cell], strict=True))
        assert close, f"{library}: {cell}: {cells[cell]}, not {sums}"
    assert any(sums[0] > 0 and sums[2] > 0 for sums in expected.values())


def with_pandas(files):
    rows = pandas.concat(map(pandas.read_csv, files))
    assert pandas.api.types.is_numeric_dtype(rows["axis:voxel.resolution"])
    groups = rows.groupby(["commit", "machine"], dropna=False).ngroups
    cells = rows.groupby(["experiment", "cell"])[SUMMED].sum()
    check("pandas", groups, {name: list(sums) for name, sums in cells.iterrows()}, files)


def with_polars(files):
    tables = [polars.read_csv(file, infer_schema_length=None) for file in files]
    rows = polars.concat(tables, how="diagonal_relaxed")
    groups = rows.select("commit", "machine").n_unique()
    cells = rows.group_by("experiment", "cell").agg(polars.col(SUMMED).sum())
    check("polars", groups, {row[:2]: list(row[2:]) for row in cells.iter_rows()}, files)


with tempfile.TemporaryDirectory() as folder:
    files = []
    for name, words in COMMANDS.items():
        out = Path(folder) / name
        subprocess.run([sys.argv[1], *words, "--out", out], check=True, stdout=subprocess.DEVNULL)
        files.append(out / "cells.csv")
    with_pandas(files)
    with_polars(files)
print("cells.csv: 2 passed, 0 failed")
