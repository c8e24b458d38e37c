#!/usr/bin/env python3
"""What peers make of the same records: PySINDy's weak form and a plain scipy fit beside whirl, in one table.

    pip install numpy scipy pysindy
    python3 peers/model_files.py [WHIRL]        # path of the program; default target/release/whirl

Each case is simulated by whirl from a shipped rig (its [plant] is the truth) and identified three times from the same CSV:
whirl identify; PySINDy's WeakPDELibrary on the state (q, q') with the model's own terms as library; least squares on Savitzky-Golay
derivatives. Printed: the greatest relative error of the coefficients of each, and the seconds taken.
"""
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

ROOT = Path(__file__).resolve().parent.parent
WHIRL = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "target/release/whirl"

# rig, seconds, coordinate, input, what the equation is solved for, terms: name, function of (x, v, u), and the coefficient of x''
# from the plant's, with x'' = sum(coefficient * term).
CASES = [
    ("duffing.toml", 60, "x", "force",
     {"u": (lambda x, v, u: u, lambda p: 1 / p["m"]), "v": (lambda x, v, u: v, lambda p: -p["c"] / p["m"]),
      "x": (lambda x, v, u: x, lambda p: -p["k"] / p["m"]), "x^3": (lambda x, v, u: x**3, lambda p: -p["k3"] / p["m"])}),
    ("duffing-impulses.toml", 60, "x", "force",
     {"u": (lambda x, v, u: u, lambda p: 1 / p["m"]), "v": (lambda x, v, u: v, lambda p: -p["c"] / p["m"]),
      "x": (lambda x, v, u: x, lambda p: -p["k"] / p["m"]), "x^3": (lambda x, v, u: x**3, lambda p: -p["k3"] / p["m"])}),
    ("van-der-pol.toml", 60, "x", None,
     {"v": (lambda x, v, u: v, lambda p: -p["a"]), "x^2 v": (lambda x, v, u: x**2 * v, lambda p: -p["b"]),
      "x": (lambda x, v, u: x, lambda p: -p["k"])}),
    ("measured-single-pendulum.toml", 30, "phi1", None,
     {"sin": (lambda x, v, u: np.sin(x), lambda p: -p["gravity"]), "v": (lambda x, v, u: v, lambda p: -p["viscous"]),
      "sign": (lambda x, v, u: np.sign(v), lambda p: -p["coulomb"]),
      "v|v|": (lambda x, v, u: v * np.abs(v), lambda p: -p["quadratic"])}),
]


def plant(rig):
    import tomllib
    return tomllib.loads((ROOT / "rigs" / rig).read_text())["plant"]


def run(*arguments):
    return subprocess.run([str(WHIRL), *map(str, arguments)], check=True, capture_output=True, text=True)


def whirl(rig, record, folder, truth):
    out = folder / "i.json"
    start = time.perf_counter()
    subprocess.run([str(WHIRL), "identify", str(record), "--rig", str(ROOT / "rigs" / rig), "--json", str(out)],
                   capture_output=True, check=False)
    took = time.perf_counter() - start
    found = {p["name"]: p["value"] for p in json.loads(out.read_text())["parameters"]}
    return {k: f for k, f in found.items()}, took


def smooth(x, dt, width):
    return [savgol_filter(x, width, 4, deriv=d, delta=dt) for d in range(3)]


def least_squares(x, u, dt, terms):
    start = time.perf_counter()
    s, v, a = smooth(x, dt, 31)
    columns = np.column_stack([f(s, v, u) for f, _ in terms.values()])
    inner = slice(50, -50)
    solution = np.linalg.lstsq(columns[inner], a[inner], rcond=None)[0]
    return dict(zip(terms, solution)), time.perf_counter() - start


def sindy(t, x, u, dt, terms):
    import pysindy as ps
    start = time.perf_counter()
    s, v, _ = smooth(x, dt, 31)
    state = np.column_stack([s, v])
    control = u if u is not None else np.zeros_like(x)
    functions = [(lambda f: lambda x, v, u: f(x, v, u))(f) for f, _ in terms.values()]
    library = ps.WeakPDELibrary(
        ps.CustomLibrary(library_functions=functions, function_names=[lambda x, v, u: "" for _ in functions]),
        spatiotemporal_grid=t, K=400, H_xt=[0.5 * min(4.0, t[-1] / 8)], p=4)
    model = ps.SINDy(optimizer=ps.STLSQ(threshold=0.0), feature_library=library)
    model.fit(state, t=t, u=control.reshape(-1, 1))
    # Functions of three arguments are taken of (x, v, u) in this order only once: the first of each group.
    row = model.coefficients()[1]
    groups = len(row) // len(functions)
    return dict(zip(terms, row[::groups])), time.perf_counter() - start


def worst(found, truth):
    return max(abs(found[k] / truth[k] - 1) for k in truth)


def main():
    print(f"{'case':<32}{'whirl':>12}{'s':>7}{'PySINDy weak':>14}{'s':>7}{'scipy':>12}{'s':>7}")
    for rig, seconds, coordinate, inputs, terms in CASES:
        p = plant(rig)
        truth = {k: f(p) for k, (_, f) in terms.items()}
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            record = folder / "r.csv"
            run("simulate", "--rig", ROOT / "rigs" / rig, "--seconds", seconds, "--seed", 1, "-o", record)
            data = np.genfromtxt(record, delimiter=",", names=True)
            t, x = data["t"], data[coordinate]
            u = data[inputs] if inputs else None
            found, took = whirl(rig, record, folder, truth)
            own = {k: v for k, v in found.items() if k in p}
            line = f"{rig:<32}{worst(own, {k: p[k] for k in own}):>12.2e}{took:>7.2f}"
            try:
                coefficients, took = sindy(t, x, u, t[1] - t[0], terms)
                line += f"{worst(coefficients, truth):>14.2e}{took:>7.2f}"
            except ImportError:
                line += f"{'not installed':>14}{'':>7}"
            except Exception as e:  # a peer that fails is a result, too
                line += f"{type(e).__name__:>14}{'':>7}"
            coefficients, took = least_squares(x, u if u is not None else np.zeros_like(x), t[1] - t[0], terms)
            print(line + f"{worst(coefficients, truth):>12.2e}{took:>7.2f}", flush=True)


if __name__ == "__main__":
    main()
