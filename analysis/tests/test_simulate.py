import sys
from pathlib import Path

import pytest

from phri_analysis import simulate, study
from phri_analysis.errors import AnalysisError, ConfigurationError, DataError, MissingInputError, UsageError

pytestmark = pytest.mark.filterwarnings("ignore:make_current is deprecated:DeprecationWarning")  # Debian's dask
FAKE = str(Path(__file__).parent / "fake")


@pytest.fixture
def fake(monkeypatch):
    """The stand-in for phri_sim, also for child processes, which inherit sys.path."""
    monkeypatch.syspath_prepend(FAKE)
    monkeypatch.delitem(sys.modules, "phri_sim", raising=False)
    simulate.plan.cache_clear()
    yield
    simulate.plan.cache_clear()
    sys.modules.pop("phri_sim", None)


REQUEST = simulate.Request("maze_assistance", participants=2, trials=2, seed=7)


def written(kept, path):
    study.write_table(kept.table(), path)
    return path.read_bytes()


def test_the_table_is_the_same_for_any_number_of_processes(fake, tmp_path):
    one = simulate.simulate(REQUEST, progress=False)
    two = simulate.simulate(REQUEST, jobs=2, progress=False)
    assert written(one, tmp_path / "one.csv") == written(two, tmp_path / "two.csv")
    assert len(one.table()) == 2 * 3 * 2 * 3  # participants, controllers, trials, subtasks
    other = simulate.simulate(simulate.Request("maze_assistance", 2, 2, seed=8), progress=False)
    assert written(other, tmp_path / "other.csv") != written(one, tmp_path / "one.csv")


def test_the_table_is_the_same_on_a_dask_cluster(fake, tmp_path):
    distributed = pytest.importorskip("distributed")
    request = simulate.Request("maze_assistance", 1, 1, seed=7)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        spread = simulate.simulate(request, scheduler=cluster.scheduler_address, progress=False)
    assert written(spread, tmp_path / "a.csv") == written(
        simulate.simulate(request, progress=False), tmp_path / "b.csv"
    )


def test_a_choice_of_controllers_leaves_the_others_numbers_alone(fake):
    whole = simulate.simulate(REQUEST, progress=False).table()
    some = simulate.simulate(simulate.Request("maze_assistance", 2, 2, ("lqr",), 7), progress=False).table()
    assert some.equals(whole[whole["controller"] == "lqr"].reset_index(drop=True))


def test_bad_requests_name_what_is_wrong(fake):
    with pytest.raises(
        UsageError, match="controller lrq is not in experiment maze_assistance; it has none, lqr, mahalanobis"
    ):
        simulate.simulate(simulate.Request("maze_assistance", controllers=("lrq",)), progress=False)
    with pytest.raises(UsageError, match="participants is 0, expected 1 or more"):
        simulate.simulate(simulate.Request("maze_assistance", participants=0), progress=False)
    with pytest.raises(UsageError, match="jobs is 0"):
        simulate.simulate(REQUEST, jobs=0, progress=False)
    with pytest.raises(DataError) as error:
        simulate.simulate(simulate.Request("bad.yaml"), progress=False)
    assert "learner/states = 0" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_failing_block_names_participant_and_controller(fake, jobs):
    with pytest.raises(
        AnalysisError, match="participant 1, controller none, seed 7: the tick faulted:; not finite"
    ) as error:
        simulate.simulate(simulate.Request("breaks", 1, 1, ("none",)), jobs=jobs, progress=False)
    assert error.value.exit_code == 70


def test_without_the_module_the_user_is_told_what_to_build(monkeypatch):
    monkeypatch.setitem(sys.modules, "phri_sim", None)
    simulate.plan.cache_clear()
    with pytest.raises(MissingInputError, match="build the workspace"):
        simulate.simulate(REQUEST, progress=False)


def test_a_scheduler_that_does_not_answer_is_named(fake):
    pytest.importorskip("distributed")
    with pytest.raises(MissingInputError, match="scheduler nonsense://x"):
        simulate.simulate(REQUEST, scheduler="nonsense://x", progress=False)


@pytest.mark.parametrize("text, pair", [
    ("assistance/q_scale=1e-3", ("assistance/q_scale", 0.001)),
    ("trials=2", ("trials", 2.0)),
    ("autonomous_completion=true", ("autonomous_completion", True)),
    ("model/reference=path", ("model/reference", "path")),
    ("override/robots/admittance/mass=[40, 40]", ("override/robots/admittance/mass", (40, 40))),
])
def test_settings_are_read_as_yaml(text, pair):
    assert simulate.setting(text) == pair


def test_settings_reach_the_experiment_and_bad_ones_are_refused():
    with pytest.raises(ConfigurationError, match="did you mean model/states"):
        simulate.simulate(simulate.Request("maze_assistance", settings=(("model/state", 5.0),)), progress=False)
    with pytest.raises(UsageError, match="expected KEY=VALUE"):
        simulate.setting("trials")
