"""Records from files, arrays and frames."""

import pickle

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


def test_what_is_masked_is_missing(record):
    for type in (np.float64, np.float32, np.int32):
        hidden = np.ma.masked_array(record["count1"].astype(type), mask=np.arange(12000) >= 11800)
        hidden.data[11800:] = 9999
        r = whirl.read({"t": record.t, "count1": hidden, "count2": record["count2"]})
        assert len(r) == 11800 and np.all(r["count1"] == record["count1"][:11800])
        assert hidden.data[11800] == 9999 and hidden.dtype == type
    whole = np.ma.masked_array(np.arange(5, dtype=np.int16), mask=False)
    assert len(whirl.read({"t": np.arange(5.0), "a": whole})) == 5


def test_masked_dates_are_missing():
    seconds = np.array(["2026-01-01T00:00:00", "2026-01-01T00:00:01", "2026-01-01T00:00:02"], dtype="M8[s]")
    r = whirl.read({"t": np.ma.masked_array(seconds, mask=[0, 0, 1]), "a": [1.0, 2.0, 3.0]})
    with pytest.raises(whirl.Error, match="sample 3, column t: found NaN"):
        r.columns


def test_dates_of_a_time_zone_are_seconds(record):
    dates = pd.DatetimeIndex(pd.Timestamp("2026-01-01", tz="Europe/Berlin") + pd.to_timedelta(record.t, unit="s"), name="time")
    r = whirl.read(pd.DataFrame({"a": np.sin(record.t)}, index=dates))
    assert abs(r.t[0]) < 1e-9 and np.isclose(r.rate, 500)


def test_a_column_of_one_column_is_taken(record):
    r = whirl.read({"t": record.t[:, None], "a": record["count1"][None, :], "b": list(map(str, record["count2"]))})
    assert np.all(r["a"] == record["count1"]) and np.all(r["b"] == record["count2"])


@pytest.mark.parametrize("source, words", [
    ({"t": np.zeros((3, 2))}, r"column t: found an array of shape \(3, 2\), expected shape \(n,\)"),
    ({"t": [0.0, 1.0], "a": [1.0, "x"]}, "sample 2, column a: found 'x', expected numbers"),
    ({"t": [0.0, 1.0], "a": pd.Series([1.0, "x"])}, "sample 2, column a: found 'x', expected numbers"),
    (3, "expected a path"), ([{"t": [0.0]}], "several arguments"), (np.zeros((3, 2)), "Name its columns"),
    ({"t": [0.0, 1.0], "a": 1.0}, "column a: found a scalar, 1.0"), ({"fs": 200, "a": [1.0, 2.0]}, "rate=fs"),
    ({"t": [0.0], "a": [1.0]}, "found 1 row, expected at least 2"), ({}, "no column"),
    ({"t": [0.0, 1.0], "a": [1.0]}, "column a: found 1 values, 2 in t"), ({"t": [[0.0], [1.0, 2.0]]}, "different lengths"),
    ({"t": [0.0, 1.0], "a": [True, False]}, "astype"), ({"t": [0.0, 1.0], "a": [1j, 2j]}, "real"),
    (pd.DataFrame(np.zeros((3, 3)), columns=["t", "a", "a"]), "column a: found 2 columns of this name"),
    (pd.DataFrame({"t": [0.0, 1.0]}, index=pd.Index([0.0, 1.0], name="t")), "column t: found it twice"),
])
def test_what_is_no_record_is_refused(source, words):
    with pytest.raises(whirl.Error, match=words) as caught:
        whirl.read(source)
    e = caught.value
    assert e.file is None and e.place in str(e) and e.found in str(e) and e.expected in str(e) and (e.remedy or "") in str(e)


def test_columns_of_two_lengths_are_told_by_their_names_beside_a_rate():
    with pytest.raises(whirl.Error, match="column theta2: found 6 values, 5 in theta1, expected columns of one length"):
        whirl.read({"theta1": np.zeros(5), "theta2": np.zeros(6)}, rate=200)


def test_a_frame_whose_index_has_no_name_is_told_so(record, rig):
    frame = pd.DataFrame(record.columns, index=record.t)
    for ask in (lambda: whirl.read(frame).columns, lambda: whirl.identify(frame, rig=rig)):
        with pytest.raises(whirl.Error, match='df.index.name = "t"') as caught:
            ask()
        assert caught.value.remedy.startswith("Where the time is the frame's index") and caught.value.file is None
    with pytest.raises(whirl.Error, match="rate=200") as caught:
        whirl.identify(record.columns, rig=rig)
    assert "index" not in str(caught.value)


def test_arrays_are_called_in_memory(record, rig):
    columns = {"t": record.t, **record.columns}
    broken = {**columns, "count1": np.where(record.t > 1, np.inf, record["count1"])}
    with pytest.raises(whirl.Error, match="^in memory: sample 502, column count1: found inf"):
        whirl.identify(broken, rig=rig)
    with pytest.raises(whirl.Error, match="^record 2, in memory: sample 502"):
        whirl.identify(columns, broken, rig=rig)
    assert repr(whirl.read(columns)).startswith("<whirl.Record in memory: 12000 samples")
    i = whirl.inspect({name: values[:2000] for name, values in columns.items()})
    assert i.json["record"]["file"] == "in memory" and "in-memory.npz" not in i.text + i.json_text


def test_a_name_that_is_no_column_lists_those_that_are(record):
    with pytest.raises(KeyError, match="expected one of count1, count2. Did you mean count1?"):
        record["coun1"]
    with pytest.raises(whirl.Error, match="The time is r.t"):
        record["t"]


def test_a_record_can_be_pickled(record):
    for r in (record, whirl.read({"t": record.t, **record.columns})):
        again = pickle.loads(pickle.dumps(r))
        assert again.path != r.path and again.rate == r.rate and np.all(again["count1"] == r["count1"])


def test_a_rate_is_a_frequency():
    with pytest.raises(whirl.Error, match="above 0 Hz"):
        whirl.read({"a": [1.0]}, rate=-1)
    with pytest.raises(whirl.Error, match="one of them"):
        whirl.read({"t": [1.0], "a": [1.0]}, rate=1)
    with pytest.raises(whirl.Error, match="a column Time beside it"):
        whirl.read({"Time": [1.0], "a": [1.0]}, rate=1)
    for options, words in [({"rate": "200"}, "rate: found '200', expected a frequency"), ({"rate": True}, "rate: found True"),
                           ({"rate": 200, "start": None}, "start: found None")]:
        with pytest.raises(whirl.Error, match=words):
            whirl.read({"a": [1.0, 2.0]}, **options)
    with pytest.raises(whirl.Error, match="none.csv"):
        whirl.read("none.csv").columns
