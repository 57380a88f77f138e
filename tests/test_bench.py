"""make bench: the arithmetic of a row, every way in which a peer can fail, and, where the programs are built, a run of
the real ones. What is fast is nothing for a test: no number here is a measured time."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
BENCH = ROOT / "scripts" / "bench"
BUILD = pathlib.Path(os.environ.get("PHRI_BUILD", ROOT / "catkin_ws" / "build"))
BUILT = all((BUILD / package / "bench" / name).is_file()
            for package, name in (("phri_sim", "bench_pipeline"), ("phri_control", "bench_mpc"),
                                  ("phri_learning", "bench_hmm")))
WHEEL = ROOT / ".venv" / "bench" / "bin" / "python"
sys.path.insert(0, str(BENCH))
import peer as peer_module  # noqa: E402
import rows  # noqa: E402

KEYS = {"name", "ours", "unit", "peer", "peer_value", "ratio", "aim", "met", "runs", "spread", "check",
        "reason"}
OURS = {
    "plan/mahalanobis": 40, "plan/lqr": 20, "plan/lqr_gains_kept": 10, "lq_solve": 15, "prediction": 25, "viterbi": 16}
SOLVES = [{"name": f"{scene}/{quantity}", "cpu_time": 60, "steps": 3}
          for scene in rows.SCENES for quantity in ("solve", "ileqr", "ikccr")]
PASSES = [{"name": f"{scene}/{quantity}", "cpu_time": 4000, "stages": 200}
          for scene in (*rows.SCENES, "mass_damper") for quantity in ("backward", "risk_backward")]
RISK = {"lq_plain/50": 5, "lq_plain/200": 20, "lq_plain/500": 50, "risk_force_noise/1_source/200": 40,
        "risk_force_noise/2_sources/50": 15, "risk_force_noise/2_sources/500": 180,
        "risk_force_noise/3_sources/200": 120}
CUMULANTS = {"Cumulants/T:50/S:2/K:2/p:4": 1000, "Cumulants/T:50/S:2/K:4/p:4": 3000,
             "Cumulants/T:500/S:2/K:4/p:4": 30000}
LEARNING = {f"{work}/{states}": 10 for work in ("viterbi", "baum_welch") for states in (10, 20, 40)}
MPC = {"backward": 20, "median": 60, "p999": 150, "allocations": 0}
TICK = {"unit": "ns", "step": {"median": 1000, "p999": 5000}, "tick": {"median": 100, "p999": 900}}
BESIDE = {"tick": {"alone": {"p999": 200}, "learning": {"p999": 300}},
          "response": {"alone": {"p999": 2000}, "learning": {"p999": 1000}}}
PROGRAM = """#!/bin/bash
case $1 in --write_case=*) echo '{}' >"${1#*=}"; exit ;; esac
echo '%s'
"""
# a peer interpreter: told the program and the case, it introduces itself and answers every line
PEER = """#!/bin/bash
name=$(basename "$1" .py)
%s
echo "a greeting that is no JSON"
echo '{"version": "'$name' 1.0", "checks": %s}'
while read -r line; do echo '%s'; done
"""
ANSWER = {spec.name: 160 for spec in rows.ROWS}


class FakePeer:
    version, checks, reason = "other 1.0", {}, ""

    def __init__(self, **changes):
        self.name = "other"
        self.__dict__.update(changes)


def one_row(ours, theirs, peer=None, **changes):
    spec = rows.Spec("x", "us", "x", ("other",), **changes)
    answered = [{} if value is None else {"x": value} for value in theirs]
    (row,) = rows.complete(spec, [{"x": value} for value in ours], {"other": peer or FakePeer()}, {"other": answered})
    return row


def test_ratio_is_the_median_of_the_rounds_own_ratios():
    """A machine that is ten times slower in one round slows both: the ratio does not see it, the medians would."""
    row = one_row([10, 100, 20], [40, 400, 80])
    assert row["ratio"] == 4.0 and row["spread"] == 0.0
    # medians are 10 and 30, whose ratio is 3; the rounds' ratios are 3, 2, 0.5
    assert one_row([10, 15, 4], [30, 30, 2])["ratio"] == 2.0


def test_ratio_says_how_many_times_better_ours_is():
    assert one_row([10], [40])["ratio"] == 4.0
    assert one_row([10], [40], more_is_better=True)["ratio"] == 0.25


def test_spread_is_the_interquartile_range_over_the_median():
    assert rows.spread_of([1, 2, 3, 4, 5]) == pytest.approx(2 / 3)
    assert rows.spread_of([7]) == 0.0


def test_row_without_peer_has_its_own_median_and_spread():
    (row,) = rows.complete(rows.Spec("x", "us", "x"), [{"x": value} for value in (1, 2, 3, 4, 5)], {}, {})
    assert set(row) == KEYS
    assert (row["ours"], row["peer"], row["peer_value"], row["ratio"], row["runs"]) == (3, None, None, None, 5)
    assert row["spread"] == pytest.approx(2 / 3)


@pytest.mark.parametrize("wrong", [1e-6, float("inf"), float("nan")])
def test_another_result_gets_no_ratio(wrong):
    row = one_row([10], [40], FakePeer(checks={"x": wrong}))
    assert row["ratio"] is None and row["peer_value"] == 40 and "another result" in row["reason"]
    assert one_row([10], [40], FakePeer(checks={"x": 1e-15}))["ratio"] == 4.0


def test_an_aim_is_met_or_missed_by_what_was_measured():
    """Beside a peer it is a least ratio, alone a largest value; a row that measured nothing has neither met nor missed
    it, and a missed one is named."""
    rows_of = {
        "met": one_row([10], [40], aim=4.0),
        "missed": one_row([10], [39], aim=4.0),
        "unknown": one_row([10], [None], aim=4.0),
        "another result": one_row([10], [400], FakePeer(checks={"x": 1.0}), aim=4.0),
        "none": one_row([10], [1]),
    }
    assert {name: row["met"] for name, row in rows_of.items()} == {
        "met": True, "missed": False, "unknown": None, "another result": None, "none": None}
    assert rows.missed(rows_of.values()) == ["aim missed: x: ratio >= 4, measured 3.9"]
    assert "ratio >= 4: missed" in rows.cells(rows_of["missed"]) and "ratio >= 4: met" in rows.cells(rows_of["met"])
    alone = rows.Spec("x", "us", "x", aim=25.0)
    assert rows.complete(alone, [{"x": 25.0}], {}, {})[0]["met"] is True
    assert rows.complete(alone, [{"x": 25.1}], {}, {})[0]["met"] is False


def test_scaling_is_per_stage_and_per_source():
    scale = rows.scaling({**RISK, **CUMULANTS})
    assert scale == pytest.approx({
        "scaling_horizon_plain": 1.0,  # ten times the stages in ten times the time
        "scaling_horizon_risk": 1.2,  # 180 over ten times 15
        "scaling_horizon_cumulants": 1.0,
        "scaling_source": 2.0,  # two sources more take 80, a plain pass 20
        "scaling_cumulants": 3.0,
    })


def test_peer_that_misses_a_round_gets_no_ratio():
    row = one_row([10, 10], [40, None])
    assert row["peer_value"] is None and row["ratio"] is None and row["reason"] == "other did not measure x"


def test_difference_is_relative_and_sees_shapes():
    assert peer_module.difference([[1.0, 4.0]], [[1.0, 5.0]]) == pytest.approx(0.2)
    assert peer_module.difference([1.0], [1.0, 2.0]) == float("inf")


def test_docs_table_is_rewritten_between_its_markers_only(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{rows.BEGIN}\nold\n{rows.END}\nafter\n")
    result = {"machine": dict.fromkeys(
        ("processor", "cores", "memory", "kernel", "compiler", "load_before", "revision"), "m"),
        "rounds": 1, "seconds": 1, "rows": [one_row([10], [40])]}
    rows.write_docs(page, result)
    once = page.read_text()
    rows.write_docs(page, result)
    assert page.read_text() == once
    assert once.startswith("before\n") and once.endswith("\nafter\n") and "old" not in once and "| 4 |" in once
    page.write_text("no markers")
    with pytest.raises(ValueError, match="has no lines"):
        rows.write_docs(page, result)


def test_page_has_the_markers():
    text = (ROOT / "docs" / "benchmarks.md").read_text()
    assert text.count(rows.BEGIN) == 1 and text.index(rows.BEGIN) < text.index(rows.END)
    for spec in rows.ROWS:
        assert f"`{spec.name}`" in text, f"docs/benchmarks.md does not say what {spec.name} is"


@pytest.fixture
def fakes(tmp_path):
    """Fake programs of ours, in folders as after a build."""
    def entries(times, *more):
        return {"benchmarks": [*({"name": name, "cpu_time": value} for name, value in times.items()), *more]}

    for name, output in {
        "phri_sim/bench/bench_tick": TICK,
        "phri_sim/bench/bench_pipeline": entries(OURS, {"name": "trials", "cpu_time": 100, "simulated_s": 20}),
        "phri_control/bench/bench_scenes": entries({}, *SOLVES, *PASSES),
        "phri_control/bench/bench_risk": entries(RISK),
        "phri_control/bench/bench_cumulants": entries(CUMULANTS),
        "phri_control/bench/bench_mpc": MPC,
        "phri_sim/bench/bench_learning": BESIDE,
        "phri_learning/bench/bench_hmm": entries(LEARNING),
        "phri_learning/bench/bench_recognition": entries({"recognise/primitives:50/states:10": 15}),
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        program(tmp_path / name, PROGRAM % json.dumps(output))
    return tmp_path


def program(path, text):
    path.write_text(text)
    path.chmod(0o755)
    return path


def run(folder, *arguments):
    """(exit status, bench.json or nothing, standard error)"""
    output = folder / "out" / "bench.json"
    done = subprocess.run(
        [sys.executable, BENCH / "bench.py", "--build", folder, "--output", output, *arguments],
        capture_output=True, text=True)
    return done.returncode, json.loads(output.read_text()) if output.exists() else None, done.stderr


def test_without_peers_every_row_is_there_and_has_none(fakes):
    status, result, _ = run(fakes, "--rounds", "2")
    assert status == 0
    assert [row["name"] for row in result["rows"]] == [spec.name for spec in rows.ROWS]
    for row in result["rows"]:
        assert set(row) == KEYS
        assert row["peer"] is row["peer_value"] is row["ratio"] is row["reason"] is None and row["runs"] == 2
    ours = {row["name"]: row["ours"] for row in result["rows"]}
    assert ours["trial_speed"] == 200.0  # 20 s in 100 ms
    assert (ours["tick_step_p999"], ours["tick_loop_median"], ours["plan_lqr"]) == (5000, 100, 20)
    assert (ours["learning_beside_tick"], ours["learning_beside_plan"]) == (1.5, 0.5)
    assert (ours["arm_solve"], ours["arm_iteration"], ours["arm_stage"]) == (60, 20, 20)
    met = {row["name"]: row["met"] for row in result["rows"]}
    assert met["mpc_backward"] and met["mpc_allocations"] and met["mpc_p999"] is False
    assert met["arm_ileqr"] is None  # an aim beside a peer says nothing without one


def peer_rows(result):
    return [row for row in result["rows"] if row["peer"]]


def test_with_peers_every_row_that_names_one_has_its_ratio(fakes):
    python = program(fakes / "python", PEER % ("", '{"viterbi": 0.0}', json.dumps(ANSWER)))
    status, result, errors = run(fakes, "--peers", python, "--rounds", "2")
    assert status == 0, errors
    assert len(peer_rows(result)) == sum(len(spec.peers) for spec in rows.ROWS)
    for row in peer_rows(result):
        expected = row["ours"] / 160 if row["name"] == "trial_speed" else 160 / row["ours"]
        assert row["ratio"] == pytest.approx(expected) and row["peer_value"] == 160
    met = {row["name"]: row["met"] for row in result["rows"]}
    assert met["point_mass_risk_stage"] and met["point_mass_ikccr"]  # 8 and 2.7
    assert met["point_mass_stage"] is False and met["point_mass_ileqr"] is False  # 8 of 10, 2.7 of 3.33
    assert met["car_stage"] is None  # no aim


@pytest.mark.parametrize("body, checks, answer, reason", [
    ("echo 'no module of that name' >&2; exit 1", "{}", ANSWER, "no module of that name"),
    ("exit 3", "{}", ANSWER, "ended with status 3"),
    ("", '{"viterbi": 0.5}', ANSWER, "another result"),
    ("", "{}", {}, "did not measure"),
    ("echo '{no JSON'", "{}", ANSWER, "answered with no JSON"),
])
def test_broken_peer_is_reported_and_not_passed_over(fakes, body, checks, answer, reason):
    python = program(fakes / "python", PEER % (body, checks, json.dumps(answer)))
    status, result, _ = run(fakes, "--peers", python, "--rounds", "1")
    assert status == 70
    row = next(row for row in result["rows"] if row["name"] == "viterbi")
    assert row["ratio"] is None and reason in row["reason"] and row["ours"] == 16


def test_missing_interpreter_and_what_pip_said_are_reported(fakes):
    told = fakes / "venv" / "not_installed"
    told.mkdir(parents=True)
    (told / "hmmlearn").write_text("pip: ERROR: no such version\n")
    status, result, _ = run(fakes, "--peers", fakes / "venv" / "bin" / "python", "--rounds", "1")
    assert status == 70
    reasons = {row["name"]: row["reason"] for row in peer_rows(result)}
    assert reasons["viterbi"] == "pip: ERROR: no such version" and "No such file" in reasons["lq_solve"]


def test_bad_arguments_and_missing_programs(fakes, tmp_path):
    assert run(fakes, "--rounds", "0")[0] == 64
    assert run(fakes, "--seconds", "nan")[0] == run(fakes, "--seconds", "inf")[0] == 64
    assert run(fakes, "--quick", "--docs", "page.md")[0] == 64
    status, result, errors = run(tmp_path / "nothing")
    assert status == 66 and result is None and "bench_tick is not there" in errors
    program(fakes / "phri_sim" / "bench" / "bench_tick", "#!/bin/bash\necho broken >&2\nexit 70\n")
    status, result, errors = run(fakes)
    assert status == 70 and result is None and "broken" in errors


@pytest.mark.parametrize("arguments, settings, status, text", [
    (["--fast"], {}, 64, "unknown argument --fast"),
    (["--rounds"], {}, 64, "--rounds needs a number"),
    ([], {"PEERS": "maybe"}, 64, "PEERS=maybe, expected yes or no"),
    ([], {"PEERS": "no"}, 66, "make build first"),
])
def test_script_refuses_what_it_does_not_understand(tmp_path, arguments, settings, status, text):
    environment = {**os.environ, "PHRI_BUILD": str(tmp_path), "PHRI_BENCH_VENV": str(tmp_path / "venv"), **settings}
    done = subprocess.run([ROOT / "scripts" / "bench.sh", *arguments], capture_output=True, text=True, env=environment)
    assert done.returncode == status and text in done.stderr
    assert not (tmp_path / "venv").exists()


@pytest.mark.skipif(not BUILT, reason="the benchmarks are not built: make bench does")
def test_real_programs_and_the_peer_that_needs_nothing(tmp_path):
    """Our programs check themselves when they start; numpy's Riccati recursion, in the system's Python, is an
    independent oracle for the first gains. The peers that this Python has not are missing, and say so."""
    output = tmp_path / "bench.json"
    done = subprocess.run([sys.executable, BENCH / "bench.py", "--build", BUILD, "--quick", "--peers",
                           "/usr/bin/python3", "--output", output], capture_output=True, text=True)
    result = json.loads(output.read_text())
    assert {row["name"] for row in result["rows"]} == {spec.name for spec in rows.ROWS}, done.stderr
    for row in result["rows"]:
        assert set(row) == KEYS and row["runs"] == 1
        assert row["ours"] == 0 if row["name"] == "mpc_allocations" else row["ours"] > 0, row
        if row["peer"] and row["peer"].startswith("numpy"):
            assert row["check"] <= rows.SAME and row["ratio"] > 0 and row["reason"] is None
    assert sum(str(row["peer"]).startswith("numpy") for row in result["rows"]) == 3


@pytest.mark.skipif(not BUILT, reason="the benchmarks are not built: make bench does")
def test_a_wrong_gain_of_ours_would_be_seen(tmp_path):
    """The oracle can fail: with one weight of the real problem changed, its gain is another one."""
    import peer_numpy

    case = tmp_path / "case.json"
    subprocess.run([BUILD / "phri_sim" / "bench" / "bench_pipeline", f"--write_case={case}"], check=True)
    problem = json.loads(case.read_text())["lq"]["mahalanobis"]
    same = peer_module.difference(peer_numpy.Riccati(problem).solve()[0], problem["gain"])
    problem["Q"][100][0][0] *= 1.001
    changed = peer_module.difference(peer_numpy.Riccati(problem).solve()[0], problem["gain"])
    assert same <= rows.SAME < changed


@pytest.mark.skipif(not BUILT or not WHEEL.is_file(), reason="needs the built benchmarks and the peers: make bench")
def test_crocoddyl_solves_our_scenes_to_our_result_and_would_say_if_not(tmp_path):
    """Its C++ solvers on our plants and costs are an independent oracle for cost and gains. With the cost of one scene
    and one gain of another changed by a millionth, exactly their rows differ."""
    environment = {**os.environ, "PHRI_BENCH_BUILD": str(BUILD), "OMP_NUM_THREADS": "1"}
    scenes = tmp_path / "scenes.json"
    subprocess.run([BUILD / "phri_control" / "bench" / "bench_scenes", f"--write_case={scenes}"], check=True)

    def ask(command):
        done = subprocess.run([*command], input='{"seconds": 0.001}\n', capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        return [json.loads(line) for line in done.stdout.splitlines()]

    hello, answer = ask([WHEEL, BENCH / "peer_crocoddyl_cpp.py", tmp_path / "case.json"])
    assert all(difference <= rows.SAME for difference in hello["checks"].values())
    assert set(answer) == {spec.name for spec in rows.ROWS if "crocoddyl_cpp" in spec.peers}
    assert set(hello["checks"]) == {name for name in answer if name.endswith(("_solve", "_iteration", "_stage"))
                                    and not name.endswith("_risk_stage")}
    ours = json.loads(scenes.read_text())
    ours["arm"]["cost"] *= 1.0 + 1e-6
    ours["car"]["gains"][100] += 1e-6 * max(map(abs, ours["car"]["gains"]))
    scenes.write_text(json.dumps(ours))
    hello, answer = ask([tmp_path / "peer_crocoddyl_cpp", scenes])
    wrong = {name for name, difference in hello["checks"].items() if not difference <= rows.SAME}
    assert wrong == {"arm_solve", "arm_iteration", "car_stage"}
    assert "arm_solve" not in answer  # neither solver ends at our cost: nothing is timed
