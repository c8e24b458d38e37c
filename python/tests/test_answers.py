"""Python's answers are the program's, and what they can be asked for."""

import inspect as python_inspect
import json
import math
import warnings

import numpy as np
import pytest

import whirl
from whirl import _whirl

#: Options that `identify` passes on without naming them.
OF_HARMONIC_BALANCE = {"basis", "beta", "delay", "differentiation", "energy_balance", "error_bound", "known_coefficient",
                       "longest_period", "low_pass", "no_mean_row", "no_optimisation", "piece_periods", "rounds",
                       "subharmonics", "tolerance"}

pytestmark = pytest.mark.filterwarnings("ignore::whirl.WhirlWarning")


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


def test_a_result_has_parameters_that_print(record, rig):
    m = whirl.identify(record, rig=rig)
    low, high = m["B11"].interval
    assert low < m["B11"].value < high and m["B11"].std_error == m.json["parameters"][0]["std_error"]
    assert math.isclose(high - low, 2 * 1.96 * m["B11"].std_error)
    assert repr(m).startswith("Identification of double-pendulum by") and "± is 95 %" in repr(m) and "kg m²" in repr(m)
    assert "<table>" in m._repr_html_()
    assert m.to_dict() == m.json and m.to_dict() is not m.json
    with pytest.raises(KeyError):
        m["B99"]


def test_an_explanation_names_the_effect_and_reports_afterwards(record, rig, program, tmp_path):
    e = whirl.explain(record, rig=rig)
    assert e.effects[0].id == "quadratic-drag" and e.effects[0].at == "arm2" and e.verdict in repr(e)
    e.report(tmp_path / "python.html")
    program("explain", record, "--rig", rig, "--report", tmp_path / "program.html")
    # The command line aside, which says where the file stands.
    report = [[line for line in (tmp_path / name).read_text().splitlines() if "--rig" not in line]
              for name in ("python.html", "program.html")]
    assert report[0] == report[1] and len(report[0]) > 20
    e.write(ledger=tmp_path / "ledger.json")
    assert json.loads((tmp_path / "ledger.json").read_text())["format"] == 1


def test_a_model_is_saved_simulated_exported(record, rig, tmp_path):
    m = whirl.identify(record, rig=rig)
    with pytest.raises(whirl.Error, match="a file that this command reads"):
        m.save(rig)
    run = m.simulate(seconds=2, initial=[1.0, 0.5, 0.0, -0.1])
    assert len(run) == 1000 and run.rate == 500 and list(run.columns) == ["count1", "count2"]
    again = whirl.explain(record, rig=rig).simulate(from_=record, start=5.0, seconds=0.02, output=tmp_path / "run.csv")
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
    with pytest.raises(whirl.Error, match="--rig"):
        whirl.identify(record)


def test_a_record_at_fault_is_an_error_with_its_json(rig, program, tmp_path):
    still = tmp_path / "still.csv"
    still.write_text("t,count1,count2\n" + "".join(f"{i / 500},7,7\n" for i in range(12000)))
    status, text, told = program("identify", still, "--rig", rig)
    with pytest.raises(whirl.Error) as caught:
        whirl.identify(still, rig=rig)
    assert status == 1 and caught.value.json == json.loads(text) and str(caught.value) in told


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
