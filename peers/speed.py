#!/usr/bin/env python3
"""Public counterparts of `cargo bench -p whirl-cli`, on the same record in the same run.

    whirl simulate --rig rigs/chaotic.toml --seconds 1340 --seed 1 -o record.csv
    whirl simulate --rig rigs/chaotic.toml --seconds 1340 --seed 1 -o record.parquet
    pip install numpy scipy numba diffrax
    python3 peers/speed.py record.csv
    WHIRL_BENCH_RECORD=record.csv WHIRL_BENCH_PARQUET=record.parquet cargo bench -p whirl-cli

Medians of several runs, wall clock, all cores. Identification: the weak form with sin^4 windows in numpy, from an .npy file (written from
the CSV beforehand) to parameters. Integration: scipy's LSODA with a right-hand side
compiled by numba, and diffrax, Coulomb's sign smoothed for both (with the sign itself they do not get past a sticking joint). Phase space: peers/phase_space.py.
A ratio counts, an absolute time does not: run both with nothing else running."""

import os
import runpy
import sys
import tempfile
import time

import numba
import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import fftconvolve, firwin

from phase_space import median_of

RATE, F_E = 500.0, 5.0
OMEGA = 2 * np.pi * F_E


def kernels(flat_hz, stop_hz, half=200):
    """A low-pass, flat to 1e-6 up to flat_hz, and its exact derivative (the kernel holds nothing near the Nyquist frequency)."""
    taps = firwin(2 * half + 1, (flat_hz + stop_hz) / 2, window=("kaiser", 12.3), fs=RATE)
    spectrum = np.fft.rfft(taps)
    slope = np.fft.irfft(2j * np.pi * np.fft.rfftfreq(taps.size, 1 / RATE) * spectrum, taps.size)
    return taps, slope


def weak_form(path, counts_per_turn=4096, flat_hz=40.0, stop_hz=80.0):
    counts = np.load(path)
    q = 2 * np.pi / counts_per_turn
    theta = (counts + 0.5) * q
    phi = np.stack([theta[:, 0], theta.sum(axis=1)])
    taps, slope = kernels(flat_hz, stop_hz)
    half = len(taps) // 2
    smooth = np.stack([fftconvolve(p - p[0], taps, mode="same") + p[0] for p in phi])
    rate = np.stack([fftconvolve(p - p[0], slope, mode="same") for p in phi])
    keep = slice(2 * half, phi.shape[1] - 2 * half)
    t = np.arange(phi.shape[1])[keep] / RATE
    phi, smooth, rate = phi[:, keep], smooth[:, keep], rate[:, keep]
    sin, cos = np.sin(smooth), np.cos(smooth)
    delta = smooth[1] - smooth[0]
    sd, cd = np.sin(delta), np.cos(delta)
    ct, st = np.cos(OMEGA * t), np.sin(OMEGA * t)
    n = int(20 * RATE / F_E)
    hop, top = n // 2, 20
    length = n / RATE
    starts = np.arange(0, phi.shape[1] - n, hop)
    shape = np.array([1, -4, 6, -4, 1]) / 16

    def rows(x, order):
        windows = np.lib.stride_tricks.sliding_window_view(x, n)[starts]
        offset = windows[:, :1]
        z = np.fft.rfft(windows - offset, axis=1)[:, : top + 3]
        z[:, 0] += offset[:, 0] * n
        z = np.concatenate([np.conj(z[:, 2:0:-1]), z], axis=1)
        out = np.zeros((len(starts), top + 1), complex)
        for k in range(5):
            m = np.arange(top + 1) + k - 2
            factor = (2j * np.pi * m / length) ** order
            out += shape[k] * factor * z[:, m + 2]
        return np.concatenate([out.real.ravel(), out.imag[:, 1:].ravel()]) / RATE

    w2, w1 = OMEGA**2, OMEGA
    coupling = rows(rate[0] * rate[1] * sd, 0)
    joint = (rows(phi[1], 1) - rows(phi[0], 1)) / w1
    found = []
    for i in range(2):
        o = 1 - i
        sign = -1 if i == 0 else 1
        columns = [
            (rows(rate[o] * cd, 1) + sign * coupling) / w2,
            rows(sin[i], 0),
            rows(sin[i] * ct, 0),
            rows(sin[i] * st, 0),
        ]
        if i == 0:
            columns.append(rows(np.sign(rate[0]), 0))
        columns.append(sign * joint)
        a = np.stack(columns, axis=1)
        b = -rows(phi[i], 2) / w2
        found.append(np.linalg.lstsq(a, b, rcond=None)[0])
    return found


P = np.array([0.11321869783, 0.07085065502, -0.11066396244, 1.01997786e-3, 3.26546619e-3, 1.68157698983, 0.26321600461, -0.41112571287, 0.04850022937])


@numba.njit
def right_hand_side(tau, y, p):
    sd, cd = np.sin(y[1] - y[0]), np.cos(y[1] - y[0])
    v = y[3] - y[2]
    f1 = p[0] * y[3] ** 2 * sd - (p[1] + p[2] * np.cos(tau)) * np.sin(y[0]) - p[3] * np.tanh(1e3 * y[2]) + p[4] * v
    f2 = -p[5] * y[2] ** 2 * sd - (p[6] + p[7] * np.cos(tau)) * np.sin(y[1]) - p[8] * v
    d = 1 - p[0] * p[5] * cd * cd
    return np.array([y[2], y[3], (f1 - p[0] * cd * f2) / d, (f2 - p[5] * cd * f1) / d])


def integrate(samples):
    tau = np.arange(samples) * (OMEGA / RATE)
    return solve_ivp(right_hand_side, (0, tau[-1]), [0.3, 2.0, 0.0, 0.0], method="LSODA", t_eval=tau, rtol=1e-8, atol=1e-8, args=(P,))


def diffrax_runs():
    """The same solution by diffrax, compiled: Dopri5 at the loosest tolerance within 2e-6 rad over 5T, a drive period at a time."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    p = jnp.asarray(P)

    def right_hand_side(tau, y, _):
        sd, cd = jnp.sin(y[1] - y[0]), jnp.cos(y[1] - y[0])
        v = y[3] - y[2]
        f1 = p[0] * y[3] ** 2 * sd - (p[1] + p[2] * jnp.cos(tau)) * jnp.sin(y[0]) - p[3] * jnp.tanh(1e3 * y[2]) + p[4] * v
        f2 = -p[5] * y[2] ** 2 * sd - (p[6] + p[7] * jnp.cos(tau)) * jnp.sin(y[1]) - p[8] * v
        d = 1 - p[0] * p[5] * cd * cd
        return jnp.stack([y[2], y[3], (f1 - p[0] * cd * f2) / d, (f2 - p[5] * cd * f1) / d])

    period = int(RATE / F_E)
    taus = jnp.arange(1, period + 1) * (OMEGA / RATE)

    def solution(samples, solver, tolerance):
        def one(y, _):
            found = diffrax.diffeqsolve(
                diffrax.ODETerm(right_hand_side),
                solver,
                0.0,
                taus[-1],
                0.1,
                y,
                saveat=diffrax.SaveAt(ts=taus),
                stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            )
            return found.ys[-1], found.ys

        run = jax.jit(lambda y: jax.lax.scan(one, y, None, length=samples // period)[1])
        return lambda: run(jnp.array([0.3, 2.0, 0.0, 0.0])).block_until_ready()

    exact = solution(5 * period, diffrax.Dopri8(), 1e-12)()
    for tolerance in [1e-7, 1e-8, 1e-9, 1e-10]:
        error = float(jnp.abs(solution(5 * period, diffrax.Dopri5(), tolerance)() - exact).max())
        if error < 2e-6:
            return tolerance, error, lambda samples: solution(samples, diffrax.Dopri5(), tolerance)
    raise SystemExit("diffrax: no tolerance reaches 2e-6")


def main():
    record = np.genfromtxt(sys.argv[1], delimiter=",", names=True)
    counts = np.stack([record["count1"], record["count2"]], axis=1).astype(np.int64)
    path = os.path.join(tempfile.mkdtemp(), "counts.npy")
    np.save(path, counts)
    seconds, found = median_of(5, lambda: weak_form(path))
    print(f"identification, numpy:           {1e3 * seconds:8.1f} ms   B11 {found[0][0]:.6f}  B21 {found[1][0]:.6f}", flush=True)
    right_hand_side(0.0, np.zeros(4), P)
    seconds, _ = median_of(1, lambda: integrate(counts.shape[0]))
    print(f"integration, LSODA with numba:   {1e3 * seconds:8.1f} ms", flush=True)
    tolerance, error, solution = diffrax_runs()
    run = solution(counts.shape[0])
    run()  # compiles
    seconds, _ = median_of(3, run)
    print(f"integration, diffrax (Dopri5):   {1e3 * seconds:8.1f} ms   tolerance {tolerance:.0e}, error over 5T {error:.1e} rad", flush=True)
    here = os.path.dirname(os.path.abspath(__file__))
    runpy.run_path(os.path.join(here, "phase_space.py"), run_name="__main__")


if __name__ == "__main__":
    main()
