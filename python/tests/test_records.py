"""Records from files, arrays and frames."""

import numpy as np
import pandas as pd
import pytest

import whirl

pytestmark = pytest.mark.filterwarnings("ignore::whirl.WhirlWarning")


@pytest.fixture(scope="module")
def csv(record, tmp_path_factory):
    """The record as a CSV with t and counts, as somebody's own."""
    path = tmp_path_factory.mktemp("own") / "run.csv"
    columns = {"t": record.t, **{name: record[name].astype(int) for name in record.columns}}
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def test_a_record_has_columns_time_rate_metadata(record):
    assert record.rate == 500 and len(record) == 12000 and record.t.shape == (12000,) and record.t.dtype == np.float64
    assert np.allclose(np.diff(record.t), 0.002) and record.segments == [slice(0, 12000)]
    assert list(record.columns) == ["count1", "count2"] and record["count1"].shape == (12000,)
    assert np.all(record["count1"] == np.round(record["count1"]))
    assert 'name = "double pendulum' in record.metadata["rig"]
    assert repr(record).startswith("<whirl.Record simulated.parquet: 12000 samples at 500 Hz in 1 segment:")
    assert record.to_frame().shape == (12000, 2)


def test_arrays_and_frames_give_what_the_file_gives(csv, rig, program):
    _, text, _ = program("identify", csv, "--rig", rig)
    frame = pd.read_csv(csv)
    arrays = {name: frame[name].to_numpy() for name in frame}
    sources = [csv, frame, frame.set_index("t"), arrays, whirl.read(arrays), whirl.read(csv)]
    for source in sources:
        assert whirl.identify(source, rig=rig).json_text == text


def test_a_rate_stands_for_a_time(record, rig):
    arrays = {name: values.astype(np.int32) for name, values in record.columns.items()}
    with_time = whirl.identify({"t": 3.0 + np.arange(12000) / 500.0, **arrays}, rig=rig)
    assert whirl.identify(whirl.read(arrays, rate=500, start=3.0), rig=rig).json == with_time.json


def test_a_nan_is_a_gap(record, rig):
    values = record["count1"].copy()
    values[5000] = np.nan
    r = whirl.read({"t": record.t, "count1": values, "count2": record["count2"]})
    assert r.segments == [slice(0, 5000), slice(5000, 11999)] and len(r) == 11999
    nullable = pd.DataFrame({"t": record.t, "count1": pd.array(values, dtype="Int64"), "count2": record["count2"]})
    assert len(whirl.read(nullable)) == 11999


def test_dates_are_seconds_from_the_first_row(record):
    dates = pd.Timestamp("2026-01-01") + pd.to_timedelta(record.t, unit="s")
    r = whirl.read(pd.DataFrame({"time": dates, "a": np.sin(record.t)}))
    assert abs(r.t[0]) < 1e-9 and np.isclose(r.rate, 500)


def test_a_time_of_another_name_and_unit(record, rig):
    r = whirl.read({"clock": record.t * 1e3, **record.columns}, time="clock:ms")
    assert np.isclose(r.rate, 500)
    known = whirl.identify(r, rig=rig).json["record"]
    assert known == whirl.identify(record, rig=rig).json["record"]


@pytest.mark.parametrize("source, words", [
    ({"t": np.zeros((3, 2))}, "shape"), ({"t": ["a", "b"]}, "numbers"), (3, "expected a path"),
])
def test_what_is_no_record_is_refused(source, words):
    with pytest.raises(whirl.Error, match=words):
        whirl.read(source)


def test_a_rate_is_a_frequency():
    with pytest.raises(whirl.Error, match="above 0 Hz"):
        whirl.read({"a": [1.0]}, rate=-1)
    with pytest.raises(whirl.Error, match="one of them"):
        whirl.read({"t": [1.0], "a": [1.0]}, rate=1)
    with pytest.raises(whirl.Error, match="none.csv"):
        whirl.read("none.csv").columns
