"""The population of simulated participants is frozen: who they are, what they do, what the documents say of it."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import studies
from phri_analysis import study
from phri_analysis.errors import DataError, UsageError

pytest.importorskip("phri_sim", reason="the workspace is not built")
from studies import _docs, _page, _people, _sensitivity, calibration  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
POPULATION = ROOT / "catkin_ws/src/phri_sim/config/participants/simulated_adults.yaml"
FROZEN = Path(__file__).parent / "data" / "simulated_adults_seed_7.csv"
SOURCES = {"calibrated", "literature", "derived", "assumed"}
SEEDS = tuple(calibration.SEEDS)


@pytest.fixture(scope="module")
def measures():
    return _people.measures(SEEDS, calibration.PEOPLE)


def test_the_people_of_seed_7_are_the_same_to_the_last_digit():
    frozen = study.read_table(FROZEN).set_index(["seed", "participant"])
    people = _people.parameters((7,), calibration.PEOPLE)
    assert list(people.columns) == list(frozen.columns)
    for key in people:
        assert (people[key].to_numpy() == frozen[key].to_numpy()).all(), key


def test_the_file_states_every_parameter_and_its_comments_are_true():
    # Nothing is left to the defaults of the library, and shape and limits, which are its own, are told as they are.
    stated = yaml.safe_load(POPULATION.read_text())
    traits = {trait.key: trait for trait in _people.experiment().traits}
    assert list(stated) == list(traits)
    comments = dict(re.findall(r"^(\w+): \{.*\}\s+# (.*)$", POPULATION.read_text(), re.M))
    assert list(comments) == list(traits)
    calibrated = []
    for key, trait in traits.items():
        assert stated[key] == {"median": trait.median, "spread": trait.spread}
        unit, shape, low, _, high, source = comments[key].split()
        assert (unit, shape) == (trait.unit, "log-normal" if trait.log_normal else "normal"), key
        assert (float(low), float(high)) == (trait.low, trait.high), key
        assert source in SOURCES, key
        calibrated += [key] if source == "calibrated" else []
    assert calibrated == ["speed"]


def test_what_the_people_of_seed_7_do_is_pinned_to_four_digits(measures):
    means = measures.loc[("whole", 7)][list(calibration.SHOWN)].mean()
    found = {name: f"{value:.4g}" for name, value in means.items()}
    assert found == {
        "completion_time": "14.49",
        "human_force": "12.25",
        "human_power": "0.5708",
        "collision_force": "0.4175",
        "collision_count": "0.7368",
    }


def test_every_seed_meets_the_bands(measures):
    assert measures["completed"].all()
    table = calibration.summary(measures)
    banded = table[table["verdict"] != ""]
    assert len(banded) == len(SEEDS) * (len(calibration.BANDED) + 1)
    assert (banded["verdict"] == "met").all(), banded


@pytest.mark.parametrize("factor, verdict", [(0.7, "missed"), (1.0, "met"), (1.5, "missed")])
def test_a_population_out_of_the_band_is_missed(measures, factor, verdict):
    changed = measures.assign(human_force=factor * measures["human_force"])
    table = calibration.summary(changed).set_index(["seed", "measure"])
    assert table.loc[(7, "human_force"), "verdict"] == verdict
    assert table.loc[(7, "human_power"), "verdict"] == "met"
    # the ratio of spread and mean does not know the scale
    assert table.loc[(7, _sensitivity.SPREAD), "verdict"] == "met"


def people_of_power(exponent, factor, people=40):
    """Outcomes y_i p^exponent of different people, p = factor."""
    base = np.linspace(1.0, 3.0, people) * factor**exponent
    return pd.DataFrame({name: base for name in _sensitivity.OUTCOMES})


def test_the_elasticity_of_a_power_law_is_its_exponent():
    for exponent in (-1, 0, 1, 2):
        low, base, high = (people_of_power(exponent, factor) for factor in (0.8, 1.0, 1.2))
        found = _sensitivity.elasticity(base, low, high, 2 * _sensitivity.CHANGE).loc["human_force"]
        # the central difference of a hyperbola is off by the square of the step: 1 / (1 - 0.04)
        expected = {-1: -1 / 0.96}.get(exponent, exponent)
        assert found["value"] == pytest.approx(expected, abs=1e-12)
        assert found["error"] == pytest.approx(0.0, abs=1e-12), "the same for everybody"


def test_the_jackknife_gives_the_standard_error_of_a_mean():
    # With everybody at 1 in between, the elasticity is a mean of differences, whose standard error is known.
    differences = np.random.default_rng(1).normal(size=30)
    flat = people_of_power(0, 1.0, 30) * 0 + 1
    low, high = (flat.add(sign * differences / 2, axis=0) for sign in (-1, 1))
    found = _sensitivity.elasticity(flat, low, high, 1.0).loc["human_force"]
    assert found["value"] == pytest.approx(differences.mean())
    assert found["error"] == pytest.approx(differences.std(ddof=1) / np.sqrt(30))


def test_every_parameter_is_moved_and_zero_by_its_spread():
    traits = _people.experiment().traits
    steps = {step.key: step for step in _sensitivity.steps(traits)}
    assert len(steps) == 2 * len(traits)
    assert steps["speed/median"].high == pytest.approx(1.2 * 0.075)
    for step in steps.values():
        if step.value:
            assert step.relative == pytest.approx((step.high - step.low) / step.value), step
    bias = steps["side_bias/median"]
    assert (bias.low, bias.high, bias.relative) == (-0.0015, 0.0015, None)


def test_small_sensitivity_is_the_same_in_two_processes_and_what_cannot_matter_does_not(measures):
    # Nobody assists: nobody gives in. Faster people need less time and more power.
    seeds, people = (7,), 4
    base = measures.loc["whole"].loc[[(7, index) for index in range(people)]]
    keys = ("speed/median", "yielding/median")
    one = _sensitivity.table(base, seeds, people, keys)
    assert one.equals(_sensitivity.table(base, seeds, people, keys, jobs=2))
    values = one.set_index(["parameter", "outcome"])["value"]
    assert (values["yielding/median"].dropna() == 0.0).all()
    assert values[("speed/median", "completion_time")] < 0 < values[("speed/median", "human_power")]


def test_correlations_find_what_is_tied_and_bound_what_is_not():
    rng = np.random.default_rng(2)
    parameters = pd.DataFrame({"tied": rng.normal(size=60), "free": rng.normal(size=60)})
    whole = pd.DataFrame({name: np.exp(parameters["tied"]) for name in _sensitivity.OUTCOMES})
    found = _sensitivity.correlations(parameters, whole)
    bound = _sensitivity.threshold(60, 104)
    assert found.loc["tied"].to_numpy() == pytest.approx(1.0)
    assert abs(found.loc["free", "human_force"]) < bound < 0.5


@pytest.fixture(scope="module")
def document():
    return _docs.DOCUMENT.read_text(encoding="utf-8")


def test_the_document_tells_the_calibration_as_it_is(measures, document):
    told = _page.markdown(*calibration.summary_rows(calibration.summary(measures)))
    assert _docs.block(document, "calibration") == told
    assert _docs.block(document, "subtasks") == _page.markdown(*calibration.subtask_rows(measures))


def test_the_document_tells_the_sensitivity_as_it_is(measures, document):
    fresh = _sensitivity.table(measures.loc["whole"], SEEDS, calibration.PEOPLE, ("speed/median",), jobs=2)
    row = _page.markdown(*calibration.sensitivity_rows(fresh)).splitlines()[-1]
    assert row in _docs.block(document, "sensitivity").splitlines()


def test_blocks_without_markers_are_named():
    text = "a\n<!-- x: generated -->\nold\n<!-- x: end -->\nb\n"
    assert _docs.replaced(text, "x", "new") == "a\n<!-- x: generated -->\nnew\n<!-- x: end -->\nb\n"
    with pytest.raises(DataError, match="block y: no markers"):
        _docs.block(text, "y")


def test_a_study_leaves_its_files(tmp_path):
    lines = studies.run("maze_assistance", studies.Options(tmp_path, people=2))
    assert any("Human power [W]" in line for line in lines)
    session = yaml.safe_load((tmp_path / "session.yaml").read_text())
    assert session["simulated_participants"] is True and session["seed"] == 7 and session["participants"] == 2
    assert session["population"]["speed"] == {"median": 0.075, "spread": 0.2, "limits": [0.03, 0.15]}
    table = study.read_table(tmp_path / "table.csv")
    assert set(table["participant"]) == {0, 1} and set(table["controller"]) == set(session["controllers"])
    assert "simulated" in (tmp_path / "report.html").read_text()
    tested = study.read_table(tmp_path / "anova.csv").set_index(["measure", "effect"])
    controllers = len(session["controllers"])
    assert tested.loc[("human_force", "subtask x controller"), "df1"] == controllers - 1
    assert tested.loc[("disagreement", "controller"), "df1"] == controllers - 2, "without (a), where there is none"


def test_bad_requests_name_what_is_wrong(tmp_path):
    with pytest.raises(UsageError, match="'maze' is unknown; known: calibration, .*maze_assistance, .*validation"):
        studies.run("maze", studies.Options(tmp_path))
    with pytest.raises(UsageError, match="people is 1, expected 2 or more"):
        studies.run("calibration", studies.Options(tmp_path, people=1))
    with pytest.raises(UsageError, match="jobs is 0"):
        studies.run("calibration", studies.Options(tmp_path, jobs=0))
    with pytest.raises(DataError, match="speed/median = 9"):
        _people.experiment((("speed/median", 9.0),))


def test_the_command_line_refuses_an_unknown_study():
    command = [sys.executable, str(ROOT / "analysis" / "bin" / "phri-analysis"), "study", "maze"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 64 and "known: calibration" in result.stderr and not result.stdout
