#!/usr/bin/env python3
"""The accuracy of a public weak form (numpy, sin^4 windows, the same as peers/speed.py times) on the records of `whirl reproduce accuracy`.

    pip install numpy scipy numba
    python3 peers/accuracy.py target/release/whirl 20

Simulates each record with `whirl simulate`, identifies it, and prints the root mean square over the seeds of the relative error of the largest
of B11, B12, B15, B21, B22, B25, and of C11, C12 and C2, with the smallest and largest of a single record beside it."""

import os
import re
import subprocess
import sys
import tempfile

import numpy as np

from speed import weak_form

TRUTH = [[0.11321869783, 0.07085065502, -0.11066396244, 0.0, 1.01997786e-3, 3.26546619e-3], [1.68157698983, 0.26321600461, -0.41112571287, 0.0, 0.04850022937]]


def errors(found):
    """Relative errors: the largest B, C11, C12, C2. B15 and B25 are amplitudes of a cosine and a sine term."""
    relative = []
    for got, true in zip(found, TRUTH):
        amplitude = np.hypot(got[2], got[3])
        relative.append([got[0] / true[0] - 1, got[1] / true[1] - 1, amplitude / abs(true[2]) - 1])
    b = np.abs(np.array(relative)).max()
    return [b, abs(found[0][4] / TRUTH[0][4] - 1), abs(found[0][5] / TRUTH[0][5] - 1), abs(found[1][4] / TRUTH[1][4] - 1)]


def main():
    program, seeds = sys.argv[1], int(sys.argv[2])
    here = os.path.dirname(os.path.abspath(__file__))
    rig = open(os.path.join(here, "..", "rigs", "chaotic.toml")).read()
    # Of low-passes flat to 8, 12, 15 and 20 f_e, and windows' frequencies up to 1 and 2 f_e, the settings of speed.py were best at both resolutions.
    for counts, seconds in [(1024, 200), (1024, 1340), (4096, 1340)]:
        rows = []
        with tempfile.TemporaryDirectory() as folder:
            path, record = os.path.join(folder, "rig.toml"), os.path.join(folder, "record.parquet")
            open(path, "w").write(re.sub(r"counts_per_turn = \d+", f"counts_per_turn = {counts}", rig))
            for seed in range(1, seeds + 1):
                subprocess.run([program, "simulate", "--rig", path, "--seconds", str(seconds), "--seed", str(seed), "-o", record, "--force"], check=True, capture_output=True)
                rows.append(errors(weak_form(columns(program, record, path, folder), counts)))
        rows = np.array(rows)
        rms, low, high = np.sqrt((rows**2).mean(axis=0)), rows.min(axis=0), rows.max(axis=0)
        print(f"{counts} counts, {seconds} s, {seeds} records")
        for name, r, a, b in zip(["largest B", "C11", "C12", "C2"], rms, low, high):
            print(f"  {name:10s} rms {r:.2e}   {a:.1e} to {b:.1e}", flush=True)


def columns(program, record, rig, folder):
    import pyarrow.parquet as parquet

    table = parquet.read_table(record, columns=["count1", "count2"])
    counts = np.stack([table["count1"].to_numpy(), table["count2"].to_numpy()], axis=1).astype(np.int64)
    path = os.path.join(folder, "counts.npy")
    np.save(path, counts)
    return path


if __name__ == "__main__":
    main()
