"""Pages of figures 4.4 to 4.10: structure, determinism, and that findings are computed from the solutions."""

import dataclasses

import numpy as np
import pytest

from figures import Options, _scene_findings, _scene_panels, scenes

FEW = Options(rollouts=60)  # enough for every estimate to exist; the statements about roll-outs are not tested here
DIGITS = 1e-9  # repeated sums in another order


@pytest.fixture(scope="module")
def driven():
    return scenes.page("4.8", FEW)


@pytest.fixture(scope="module")
def obstacle():
    return _scene_panels.solved("4.6", ("4.6",))


def test_page_has_every_panel_sample_and_table(driven):
    assert driven.id == "4.8" and len(driven.figure.axes) == 4
    assert sorted(driven.data["panel"].unique()) == list("abcd")
    counts = driven.data.groupby("panel")["sample"].count()
    assert (counts == 201).all()  # 2 s of 0.01 s
    assert driven.data.groupby("panel")["u_1"].apply(lambda u: u.isna().sum()).eq(1).all()  # no control at the end
    numbers = driven.data.drop(columns="panel")
    assert np.isfinite(numbers[driven.data["sample"] < 200].to_numpy()).all()
    assert list(driven.tables) == ["status", "cumulants", "rollouts"]
    status = driven.tables["status"]
    assert (status["max_l"] < 1e-6).all()
    assert not any("time" in name or "second" in name for name in status.columns)
    assert ((status["share"] < 1.0) == (status["status"] != "Converged")).all()
    assert len(driven.tables["cumulants"]) == 4 * 2  # panels, sources
    assert driven.tables["rollouts"]["panel"].tolist() == list("abcd")
    assert driven.setting["rollouts"] == FEW.rollouts


def test_page_is_the_same_again(driven):
    again = scenes.page("4.8", FEW)
    assert again.findings == driven.findings
    assert again.data.equals(driven.data)
    for name, table in driven.tables.items():
        assert table.equals(again.tables[name]), name


def test_trajectory_and_gains_are_the_solutions(obstacle):
    # the nominal obeys the scene's own step, and the gain on a mover is the slope of the control in its position
    panel = obstacle[0]
    states, result = panel.result.states, panel.result
    for k in (0, 20, 49):
        np.testing.assert_allclose(panel.scene.step(states[k], result.controls[k]), states[k + 1], atol=DIGITS)
    begin = panel.scene.movers["obstacle"]
    np.testing.assert_array_equal(panel.gains("obstacle")[3], result.gains[3][:, begin : begin + 2])
    table = _scene_panels.data([panel])
    assert table["gain_obstacle_12"][3] == result.gains[3][0, begin + 1]
    assert table["goal_y"][0] == panel.scene.start[panel.scene.movers["goal"] + 1]


def test_arm_is_shown_where_its_hand_is():
    panel = _scene_panels.solved("4.9", ("4.9",))[0]
    np.testing.assert_allclose(panel.places("robot")[0], [0.3, 0.4], atol=DIGITS)  # the caption's start


def test_findings_follow_the_numbers(obstacle):
    # with the neutral result in place of the averse one the statement turns into a miss
    lines = _scene_findings.of("4.6", obstacle)
    assert any(line.startswith("holds: the mean-variance trajectory (b) clearly differs") for line in lines)
    same = [dataclasses.replace(panel, result=obstacle[0].result) for panel in obstacle]
    lines = _scene_findings.of("4.6", same)
    assert any(line.startswith("MISS: the mean-variance trajectory (b) clearly differs") for line in lines)
    assert any(line.startswith("holds: every panel has a policy") for line in lines)


def test_reduced_attitudes_and_doubtful_models_are_said(obstacle):
    lines = _scene_findings.of("4.6", obstacle)
    missing = [line for line in lines if "every panel has a policy" in line]
    assert missing[0].startswith("MISS") and "not positive definite" in missing[0]
    spread = [line for line in lines if "obstacle spreads less" in line]
    assert spread[0].startswith("MISS") and f"{obstacle[0].scene.obstacle_spread[0]:.3g}" in spread[0]
    quiet = _scene_panels.solved("4.6", ("4.6",))[:1]
    quiet[0].scene.set_diffusion(1, 1e-3 * np.eye(4))
    assert [line for line in _scene_findings.of("4.8", quiet) if "obstacle spreads less" in line][0].startswith("holds")
