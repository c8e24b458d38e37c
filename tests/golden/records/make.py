"""Makes the records of this folder anew: `python3 make.py` with h5py, numpy and scipy; `octave.h5` and `octave-5.mat` by GNU Octave.

Each holds the same 400 samples of a free swing at 500 Hz as counts of 4096 a turn: t, count1, count2. The reader's tests compare them.
"""

import subprocess
from pathlib import Path

import h5py
import numpy as np
import scipy.io

here = Path(__file__).parent
i = np.arange(400)
t = i / 500.0
count1 = np.floor(900 * np.cos(5.1 * t) + 260 * np.cos(11.3 * t + 0.4)).astype(np.int32)
count2 = np.floor(700 * np.cos(11.3 * t) - 310 * np.cos(5.1 * t + 0.2)).astype(np.int32)
matrix = np.column_stack([t, count1, count2])


def matlab(name, fill):
    """A file as MATLAB's save -v7.3 lays it out: a user block of 512 bytes, old groups, chunks deflated, classes as attributes."""
    path = here / name
    with h5py.File(path, "w", userblock_size=512, libver="earliest", track_order=False) as f:
        refs = f.create_group("#refs#")

        def put(group, key, x, kind="double"):
            x = np.atleast_2d(x)
            d = group.create_dataset(key, data=x, chunks=x.shape, compression="gzip", compression_opts=3)
            d.attrs["MATLAB_class"] = np.bytes_(kind)
            return d

        fill(f, refs, put)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, laid out by h5py HDF5 schema 1.00 .".ljust(116) + bytes(8) + b"\x00\x02IM"
    with path.open("r+b") as raw:
        raw.write(head)


def plain(f, refs, put):
    put(f, "t", t)
    put(f, "count1", count1.astype(float))
    put(f, "count2", count2, "int32")


def nested(f, refs, put):
    run = f.create_group("run")
    run.attrs["MATLAB_class"] = np.bytes_("struct")
    put(run, "t", t)
    put(run, "note", np.frombuffer("free".encode("utf-16-le"), np.uint16).reshape(-1, 1), "char")
    cells = [put(refs, "b", count1.astype(float)), put(refs, "c", count2.astype(np.float32), "single")]
    cell = run.create_dataset("counts", data=np.array([[c.ref for c in cells]], dtype=h5py.ref_dtype))
    cell.attrs["MATLAB_class"] = np.bytes_("cell")
    many = f.create_group("many")
    many.attrs["MATLAB_class"] = np.bytes_("struct")
    each = [put(refs, "d", np.arange(3.0)), put(refs, "e", t)]
    many.create_dataset("x", data=np.array([[c.ref for c in each]], dtype=h5py.ref_dtype))
    put(f, "m", matrix.T)


matlab("plain-7.3.mat", plain)
matlab("nested-7.3.mat", nested)
with h5py.File(here / "h5py.h5", "w") as f:
    f.create_dataset("run/t", data=t)
    f.create_dataset("run/counts", data=matrix[:, 1:].astype("<i4"), chunks=(100, 2), compression="gzip", shuffle=True)
    f.create_dataset("note", data="free swing")
scipy.io.savemat(here / "scipy-5.mat", {"t": t, "run": {"a": count1, "deep": {"b": count2}}, "m": matrix}, do_compression=True)
script = """
i = (0:399)'; t = i/500; count1 = floor(900*cos(5.1*t) + 260*cos(11.3*t + 0.4)); count2 = floor(700*cos(11.3*t) - 310*cos(5.1*t + 0.2));
run.t = t; run.c = {count1, count2, "a text"}; many(1).x = 1:3; many(2).x = t; m = [t count1 count2]; z = t + 1i*t; s = sparse(t);
save("-v7", "octave-5.mat", "run", "many", "m", "z", "s"); save("-hdf5", "octave.h5", "t", "count1", "count2");
"""
subprocess.run(["octave", "--no-gui", "--quiet", "--eval", script], cwd=here, check=True)
