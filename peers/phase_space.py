#!/usr/bin/env python3
"""The public counterparts of benches/phase_space.rs on the same data: numba and numpy (average mutual information), scipy's
cKDTree (false nearest neighbours, largest Lyapunov exponent).

    whirl simulate --rig rigs/chaotic.toml --seconds 1340 --seed 1 -o record.csv
    pip install numpy scipy numba
    python3 peers/phase_space.py record.csv
    WHIRL_BENCH_RECORD=record.csv cargo bench -p whirl-cli --bench phase_space

Times are medians of several runs, wall clock, all cores. cKDTree gets the least work that the method allows: the two nearest
(itself and one more), no Theiler window, angles on the circle by its `boxsize`; the Lyapunov script the same series, delay,
dimension and steps as ours. A ratio counts, an absolute time does not: run both with nothing else running."""

import resource
import sys
import time

import numba
import numpy as np
from scipy.spatial import cKDTree


def median_of(runs, work):
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - start)
    return float(np.median(times)), result


@numba.njit(parallel=True, fastmath=True)
def information_numba(cells, lags, bins):
    out = np.zeros(lags)
    for lag in numba.prange(1, lags + 1):
        joint = np.zeros((bins, bins), np.int64)
        n = cells.size - lag
        for i in range(n):
            joint[cells[i], cells[i + lag]] += 1
        a = joint.sum(axis=1)
        b = joint.sum(axis=0)
        total = 0.0
        for i in range(bins):
            for j in range(bins):
                if joint[i, j] > 0:
                    total += joint[i, j] / n * np.log2(joint[i, j] * n / (a[i] * b[j]))
        out[lag - 1] = total
    return out


def information_numpy(cells, lags, bins):
    out = []
    for lag in range(1, lags + 1):
        joint = np.bincount(cells[:-lag] * bins + cells[lag:], minlength=bins * bins).reshape(bins, bins) / (cells.size - lag)
        product = joint.sum(axis=1)[:, None] * joint.sum(axis=0)[None, :]
        mask = joint > 0
        out.append(float((joint[mask] * np.log2(joint[mask] / product[mask])).sum()))
    return np.array(out)


def false_neighbours(turns, delay, dimensions):
    n = turns.size - dimensions * delay
    shares = []
    for d in range(1, dimensions + 1):
        vectors = np.stack([turns[j * delay : j * delay + n] for j in range(d)], axis=1)
        tree = cKDTree(vectors, boxsize=1.0)
        distance, index = tree.query(vectors, k=2, workers=-1)
        jump = np.abs(turns[np.arange(n) + d * delay] - turns[index[:, 1] + d * delay])
        jump = np.minimum(jump, 1 - jump)
        shares.append(float(np.mean(jump > 15 * distance[:, 1])))
    return shares


def lyapunov(turns, delay, dimension, theiler, steps, rate):
    n = turns.size - (dimension - 1) * delay - steps
    vectors = np.stack([turns[j * delay : j * delay + turns.size - (dimension - 1) * delay] for j in range(dimension)], axis=1)
    tree = cKDTree(vectors[:n], boxsize=1.0)
    near = np.full(n, -1)
    k = 8
    open_ = np.arange(n)
    while open_.size and k <= 4096:
        _, index = tree.query(vectors[open_], k=k, workers=-1)
        far = np.abs(index - open_[:, None]) > theiler
        has = far.any(axis=1)
        near[open_[has]] = index[has, far[has].argmax(axis=1)]
        open_ = open_[~has]
        k *= 4
    here = np.nonzero(near >= 0)[0]
    curve = []
    for step in range(steps):
        d = np.abs(vectors[here + step] - vectors[near[here] + step])
        d = np.minimum(d, 1 - d)
        r = np.sqrt((d * d).sum(axis=1))
        curve.append(np.log(r[r > 0]).mean())
    t = np.arange(steps) / rate
    return np.polyfit(t[50:250], np.array(curve)[50:250], 1)[0]


def main():
    record = np.genfromtxt(sys.argv[1], delimiter=",", names=True)
    counts = record["count2"].astype(np.int64) % 4096
    turns = (counts + np.random.default_rng(1).random(counts.size)) / 4096 % 1.0
    cells = (turns * 64).astype(np.int64)
    print(f"{counts.size} samples")
    small = cells.astype(np.uint8)
    information_numba(small, 2, 64)
    seconds, bits = median_of(15, lambda: information_numba(small, 100, 64))
    print(f"mutual information, numba loop:  {1e3 * seconds:8.1f} ms   I(24) {bits[23]:.6f}", flush=True)
    seconds, bits = median_of(3, lambda: information_numpy(cells, 100, 64))
    print(f"mutual information, numpy:       {1e3 * seconds:8.1f} ms   I(24) {bits[23]:.6f}", flush=True)
    seconds, shares = median_of(1, lambda: false_neighbours(turns, 24, 10))
    print(f"false neighbours, cKDTree:       {1e3 * seconds:8.1f} ms   " + " ".join(f"{s:.4f}" for s in shares), flush=True)
    seconds, exponent = median_of(3, lambda: lyapunov(turns[:30_000], 24, 5, 100, 500, 500.0))
    print(f"Lyapunov exponent, cKDTree:      {1e3 * seconds:8.1f} ms   {exponent:.4f} 1/s")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
