"""Every block of Python in docs/python.md runs, and every notebook."""

import re
import warnings

import nbformat
import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from nbclient import NotebookClient

NOTEBOOKS = sorted((ROOT / "python" / "notebooks").glob("*.ipynb"))


@pytest.mark.filterwarnings("ignore::whirl.WhirlWarning")
def test_every_block_of_the_page_runs(record, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = {f"theta{arm}": (record[f"count{arm}"] + 0.5) * 2 * np.pi / 4096 for arm in (1, 2)}
    pd.DataFrame({"t": record.t, **columns}).to_csv("run.csv", index=False)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "python.md").read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) >= 4
    names: dict = {}
    for number, block in enumerate(blocks, 1):
        exec(compile(block, f"docs/python.md, block {number}", "exec"), names)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_notebook_runs(path, rig, tmp_path):
    text = path.read_text(encoding="utf-8").replace("../../rigs/chaotic.toml", rig.as_posix())
    notebook = nbformat.reads(text, as_version=4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = "".join(str(cell.get("outputs")) for cell in notebook.cells if cell.cell_type == "code")
    assert "quadratic-drag@arm2" in shown
