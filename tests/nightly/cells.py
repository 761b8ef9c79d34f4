"""cells.csv of a run and of a sweep, joined by pandas and by polars as docs/exporters.md says. Argument: the program."""

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
# Stages below the clock's resolution have no time, and medians do not add up exactly. Counted for each stage, a frame is ten times too long.
SUM_OVER_FRAME = (0.5, 1.5)


def check(library, groups, cells):
    """Groups by commit and machine, and cells with the sum of their stages and gaps, and their frame's time."""
    assert groups == 1, f"{library}: {groups} commits and machines, of one program"
    assert len(cells) >= 4, f"{library}: {len(cells)} cells"
    for name, stages, frame in cells:
        assert SUM_OVER_FRAME[0] < stages / frame < SUM_OVER_FRAME[1], f"{library}: {name}: {stages} of {frame}"


def with_pandas(files):
    rows = pandas.concat(map(pandas.read_csv, files))
    assert pandas.api.types.is_numeric_dtype(rows["axis:voxel.resolution"])
    groups = rows.groupby(["commit", "machine"], dropna=False).ngroups
    rows["frame_ns"] = rows["frame_untimed_median_ns"] * rows["timing_cost"]
    columns = ["median_ns", "frame_in_no_stage_ns", "frame_ns"]
    cells = rows[rows["status"] == "measured"].groupby(["experiment", "cell"])[columns].sum()
    cells = cells[cells["frame_ns"] > 0]
    check("pandas", groups, [(name, row.iloc[0] + row.iloc[1], row.iloc[2]) for name, row in cells.iterrows()])


def with_polars(files):
    tables = [polars.read_csv(file, infer_schema_length=None) for file in files]
    rows = polars.concat(tables, how="diagonal_relaxed")
    groups = rows.select("commit", "machine").n_unique()
    frame = (polars.col("frame_untimed_median_ns") * polars.col("timing_cost")).sum().alias("frame_ns")
    stages = (polars.col("median_ns").sum() + polars.col("frame_in_no_stage_ns").sum()).alias("stages_ns")
    measured = rows.filter(polars.col("status") == "measured")
    cells = measured.group_by("experiment", "cell").agg(stages, frame).filter(polars.col("frame_ns") > 0)
    check("polars", groups, [(row[:2], row[2], row[3]) for row in cells.iter_rows()])


with tempfile.TemporaryDirectory() as folder:
    files = []
    for name, words in COMMANDS.items():
        out = Path(folder) / name
        subprocess.run([sys.argv[1], *words, "--out", out], check=True, stdout=subprocess.DEVNULL)
        files.append(out / "cells.csv")
    with_pandas(files)
    with_polars(files)
print("cells.csv: 2 passed, 0 failed")
