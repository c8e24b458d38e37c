"""Python's answers are the program's, and what they can be asked for."""

import copy
import html
import inspect as python_inspect
import json
import math
import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest

import whirl
from whirl import _results, _whirl

#: Options that `identify` passes on without naming them.
OF_HARMONIC_BALANCE = {"basis", "beta", "delay", "differentiation", "energy_balance", "error_bound", "known_coefficient",
                       "longest_period", "low_pass", "no_mean_row", "no_optimisation", "piece_periods", "rounds",
                       "subharmonics", "tolerance"}

pytestmark = pytest.mark.filterwarnings("ignore::whirl.WhirlWarning")


@pytest.fixture(scope="module")
def m(record, rig):
    return whirl.identify(record, rig=rig)


@pytest.fixture(scope="module")
def e(record, rig):
    return whirl.explain(record, rig=rig)


@pytest.fixture(scope="module")
def v(record, rig, m):
    return whirl.validate(record, rig=rig, model=m, starts=10)


@pytest.mark.parametrize("options", [{}, {"method": "weak"}, {"from_": 2.0, "to": 20.0}, {"bound": {"C11": (0, None)}},
                                     {"map": {"theta1": "count1"}}])
def test_identify_is_the_program(record, rig, same, options):
    words = {"method": ["--method", "weak"], "from_": ["--from", "2", "--to", "20"], "bound": ["--bound", "C11=0:"],
             "map": ["--map", "theta1=count1"]}
    same(whirl.identify(record, rig=rig, **options), "identify", record, "--rig", rig, *words.get(next(iter(options), ""), []))


def test_every_other_command_is_the_program(record, rig, same, tmp_path):
    m = whirl.identify(record, rig=rig)
    m.save(tmp_path / "model.toml")
    same(whirl.explain(record, rig=rig, most_effects=1), "explain", record, "--rig", rig, "--most-effects", "1")
    same(whirl.validate(record, rig=rig, model=m, starts=10), "validate", record, "--rig", rig, "--model", tmp_path / "model.toml",
         "--starts", "10")
    same(whirl.inspect(record), "inspect", record)
    same(whirl.reduce(record, rig=rig), "reduce", record, "--rig", rig)


def test_a_result_has_parameters_that_print(m):
    low, high = m["B11"].interval
    assert low < m["B11"].value < high and m["B11"].std_error == m.json["parameters"][0]["std_error"]
    assert math.isclose(high - low, 2 * 1.96 * m["B11"].std_error)
    assert "Identification of double-pendulum by" in repr(m) and "± is 95 %" in repr(m) and "kg m²" in repr(m)
    assert "<table>" in m._repr_html_()
    assert m.to_dict() == m.json and m.to_dict() is not m.json
    with pytest.raises(KeyError, match="parameter: found 'B99', expected one of ") as caught:
        m["B99"]
    assert isinstance(caught.value, whirl.Error) and "B11" in caught.value.expected


def test_a_value_that_rounds_to_zero_has_no_sign():
    told = [_results.plus_minus(value, 0.016) for value in (-0.0001, -0.31)]
    assert told == ["0.000 ± 0.016", "-0.310 ± 0.016"]


def test_what_is_printed_opens_with_the_verdict(m, e, v):
    opening = m.text.splitlines()[0]
    assert repr(m).splitlines()[0] == opening and html.escape(opening) in m._repr_html_()
    fallen = replace(m, positive=False, text="This answer cannot stand: an arm rests.\n\nParameters\n", reasons=("this answer cannot stand",))
    assert repr(fallen).splitlines()[:2] == ["This answer cannot stand: an arm rests.", repr(m).splitlines()[1]]
    strict = replace(m, positive=False, text="All is well.\n", reasons=("a sample is missing",))
    assert repr(strict).splitlines()[:2] == ["a sample is missing", "All is well."]
    assert e.positive and repr(e).splitlines()[0] == e.text.splitlines()[0]
    assert repr(v) == v.text.strip() and len(repr(v).splitlines()) > 12


def test_an_answer_is_taken_wherever_a_model_is(record, rig, m, e, same, tmp_path):
    path = tmp_path / "model.toml"
    e.save(path)
    again = whirl.explain(record, rig=rig, model=e, most_effects=0)
    same(again, "explain", record, "--rig", rig, "--model", path, "--most-effects", "0")
    again.report(tmp_path / "second.html")
    assert "--model=the model in memory" in (tmp_path / "second.html").read_text(encoding="utf-8")
    for answer in (e, m):
        answer.save(path, force=True)
        run = whirl.simulate(rig, model=answer, seconds=1)
        assert np.all(run["count1"] == whirl.simulate(rig, model=path, seconds=1)["count1"])


@pytest.mark.parametrize("command", [whirl.explain, whirl.validate])
def test_what_names_no_file_is_refused(command, record, rig, m):
    for options, words in [({"model": {}}, "model: found dict, expected the path of a model file, or an answer"),
                           ({"model": 3}, "model: found int"), ({"rig": {"name": "x"}}, "rig: found dict, expected the path of a rig file"),
                           ({"rig": 'name = "x"\n'}, "rig: found a text of several lines"), ({"report": True}, "report: found bool")]:
        with pytest.raises(whirl.Error, match=words) as caught:
            command(record, **{"rig": rig, **options})
        assert caught.value.place == next(iter(options))
    with pytest.raises(whirl.Error, match="model: found Parameters"):
        whirl.simulate(rig, model=m.parameters)
    with pytest.raises(whirl.Error, match="records: found none"):
        command(rig=rig)


def test_a_draft_says_what_comes_next_in_python(record, tmp_path):
    columns = {"t": record.t, **{f"theta{arm}": (record[f"count{arm}"] + 0.5) * 2 * np.pi / 4096 for arm in (1, 2)}}
    path = tmp_path / "rig.toml"
    d = whirl.init(columns, output=path)
    assert d.rig == path and d.json["draft"]["record"] == "in memory"
    assert repr(d).endswith(f"Next: whirl.inspect(record, rig={str(path)!r}), then whirl.identify(record, rig={str(path)!r})")
    assert whirl.identify(columns, rig=d).json == whirl.identify(columns, rig=path).json


def test_only_what_is_written_is_an_option_of_write(e, tmp_path):
    for name, words in [("window_s", "write: found 'window_s'"), ("reprot", "Did you mean report?")]:
        with pytest.raises(whirl.Error, match=words):
            e.write(**{name: tmp_path / "x"})
    assert not list(tmp_path.iterdir())


def test_answers_can_be_pickled_and_copied(record, rig, m, e, v, tmp_path):
    for answer in (m, e, v, whirl.inspect({"t": record.t[:2000], "count1": record["count1"][:2000]})):
        again = pickle.loads(pickle.dumps(answer))
        assert again == answer and repr(again) == repr(answer) and len(again.records[0]) == len(answer.records[0])
    for number, model in enumerate((m, e)):
        names = [tmp_path / f"{number}{kind}.toml" for kind in ("first", "again")]
        again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(model))))
        model.save(names[0])
        again.save(names[1])
        assert names[0].read_text() == names[1].read_text() and len(again.simulate(seconds=1)) == 500
        with pytest.raises(whirl.Error, match="already"):
            again.save(names[1])
        with pytest.raises(whirl.Error, match="came from"):
            again.save(rig, force=True)
        with pytest.raises(whirl.Error, match="can be written"):
            again.save(tmp_path / "none" / "model.toml")
        with pytest.raises(whirl.Error, match="an answer from a pickle"):
            again.report(tmp_path / "no.html")
    twin = copy.deepcopy(m)
    twin.report(tmp_path / "twin.html")
    assert twin == m and twin.json is not m.json


def test_an_explanation_names_the_effect_and_reports_afterwards(record, rig, e, program, tmp_path):
    assert e.effects[0].id == "quadratic-drag" and e.effects[0].at == "arm2" and e.verdict in repr(e)
    e.report(tmp_path / "python.html")
    program("explain", record, "--rig", rig, "--report", tmp_path / "program.html")
    # The command line aside, which says where the file stands.
    report = [[line for line in (tmp_path / name).read_text().splitlines() if "--rig" not in line]
              for name in ("python.html", "program.html")]
    assert report[0] == report[1] and len(report[0]) > 20
    e.write(ledger=tmp_path / "ledger.json")
    assert json.loads((tmp_path / "ledger.json").read_text())["format"] == 1


def test_a_model_is_saved_simulated_exported(record, rig, m, e, tmp_path):
    with pytest.raises(whirl.Error, match="a file that this command reads"):
        m.save(rig)
    run = m.simulate(seconds=2, initial=[1.0, 0.5, 0.0, -0.1])
    assert len(run) == 1000 and run.rate == 500 and list(run.columns) == ["count1", "count2"]
    again = e.simulate(from_=record, start=5.0, seconds=0.02, output=tmp_path / "run.csv")
    assert abs(again["count1"][0] - record["count1"][np.searchsorted(record.t, 5.0 - 1e-9)]) <= 2
    with pytest.raises(whirl.Error, match="4 numbers") as caught:
        m.simulate(initial=np.zeros(3))
    assert caught.value.place == "--initial"
    m.export("python", tmp_path / "model.py")
    compile((tmp_path / "model.py").read_text(), "model.py", "exec")


def test_errors_carry_the_programs_message(record, rig, program, tmp_path):
    broken = tmp_path / "broken.csv"
    broken.write_text("t,count1,count2\n0,1,x\n")
    for source, options, words in [(broken, {}, []), ("none.parquet", {}, []), (record, {"from_": 30.0}, ["--from", "30"]),
                                   (record, {"window_s": -1.0}, ["--window-s=-1"])]:
        status, _, told = program("identify", source, "--rig", rig, *words)
        with pytest.raises(whirl.Error) as caught:
            whirl.identify(source, rig=rig, **options)
        assert status == 2 and told == f"whirl: {caught.value}\n" and isinstance(caught.value, ValueError)
    with pytest.raises(whirl.Error) as caught:
        whirl.identify(broken, rig=rig)
    e = caught.value
    assert str(e.file) == str(broken) and e.found in str(e) and e.expected in str(e) and e.remedy in str(e) and e.place in str(e)


def test_usage_errors_carry_the_programs_message(record, rig, program):
    for options, words in [({"method": "guess"}, ["--method", "guess"]), ({"no_such": 1}, ["--no-such", "1"])]:
        _, _, told = program("identify", record, "--rig", rig, *words)
        with pytest.raises(whirl.Error) as caught:
            whirl.identify(record, rig=rig, **options)
        assert str(caught.value).splitlines()[0].split("=")[0].rstrip("'") in told
    with pytest.raises(whirl.Error, match="--rig") as caught:
        whirl.identify(record)
    assert [getattr(caught.value, part) for part in ("file", "place", "found", "expected", "remedy", "json")] == [None] * 6


def test_a_record_at_fault_is_an_error_with_its_json(rig, program, tmp_path):
    still = tmp_path / "still.csv"
    still.write_text("t,count1,count2\n" + "".join(f"{i / 500},7,7\n" for i in range(12000)))
    status, text, told = program("identify", still, "--rig", rig)
    with pytest.raises(whirl.Error) as caught:
        whirl.identify(still, rig=rig)
    assert status == 1 and caught.value.json == json.loads(text) and str(caught.value) in told
    assert [getattr(caught.value, part) for part in ("file", "place", "found", "expected", "remedy")] == [None] * 5


def test_warnings_are_pythons(record, rig):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        m = whirl.identify(record, rig=rig)
    ours = [w for w in caught if issubclass(w.category, whirl.WhirlWarning)]
    assert [w.message.id for w in ours] == [w["id"] for w in m.json["warnings"]] and ours
    assert all(w.filename == __file__ for w in ours)
    assert str(ours[0].message) == "{text}. {advice}".format(**m.json["warnings"][0])


def test_nothing_is_printed(record, rig, capfd):
    whirl.identify(record, rig=rig)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("function", [whirl.identify, whirl.explain, whirl.validate, whirl.inspect, whirl.reduce, whirl.init,
                                      whirl.simulate])
def test_every_option_is_a_keyword(function):
    names = {"o": "output", "from": "from_"}
    options = {names.get(name, name).replace("-", "_") for name, _, _ in _whirl.options(function.__name__)}
    keywords = set(python_inspect.signature(function).parameters)
    missing = options - keywords
    if "balance" in keywords:
        keywords -= {"balance"}
        assert missing == OF_HARMONIC_BALANCE
        missing = set()
    assert not missing and not keywords - options, (missing, keywords - options)
    assert function.__doc__
