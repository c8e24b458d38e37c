"""Proper orthogonal decomposition by the method of snapshots in numpy's BLAS: the peer of `cargo bench -p whirl-cli --bench reduction`.

Median of the wall times of a few runs, on records of the same sizes made in the same way.
"""

import statistics
import time

import numpy


def record(channels, samples):
    """Ten slow modes and a little hash noise, as in host/benches/reduction.rs."""
    i = numpy.arange(samples)
    rows = []
    for c in range(channels):
        noise = ((i * 2654435761 + c * 40503) % 1000) * 1e-3
        rows.append(sum(numpy.sin(0.0137 * k * i + 0.1 * c * k) / k for k in range(1, 11)) + 1e-3 * noise)
    return numpy.array(rows)


for channels, samples, runs in [(200, 20_000, 15), (2000, 20_000, 3)]:
    x = record(channels, samples)
    walls = []
    for _ in range(runs):
        start = time.perf_counter()
        centred = x - x.mean(axis=1, keepdims=True)
        values, modes = numpy.linalg.eigh(centred @ centred.T / samples)
        walls.append(time.perf_counter() - start)
    print(f"pod {channels} x {samples}: {statistics.median(walls):.4f} s, first share {values[-1] / values.sum():.6f}")
