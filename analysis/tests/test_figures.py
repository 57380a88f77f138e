"""Figures of the thesis: files, index and errors of the pages; the gains of 4.1 to 4.3 against oracles of their own."""

import dataclasses
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.linalg import solve_discrete_are

import figures
from figures import _page
from phri_analysis import plots, study
from phri_analysis.errors import DataError, OutputError, UsageError

ROOT = Path(__file__).resolve().parents[2]
GAIN_ERROR = 1e-8  # N/m: the oracles iterate to 1e-12 or so, the library's horizons end at 1e-7 and square it


def empty_figure():
    fig = plots.figure(2.0, 1.5)
    fig.add_subplot().plot([0.0, 1.0], [0.0, 1.0])
    return fig


def a_page(name="9.9", **changes):
    values = {
        "id": name,
        "title": "A line",
        "thesis": "A line & <nothing> else.",
        "setting": {"step": np.float64(0.1), "weights": (1, np.int64(2)), "deep": {"matrix": np.eye(2)}},
        "deviations": ("None.",),
        "data": pd.DataFrame({"x": [0.1, math.nan], "name": ["a", "b,c"]}),
        "figure": empty_figure(),
        "findings": (figures.finding(True, "it rises", "1 > 0"), figures.finding(False, "it falls", "1 > 0"), "plain"),
        "tables": {"more_numbers": pd.DataFrame({"count": range(50)})},
    }
    return figures.Page(**{**values, **changes})


@pytest.fixture
def known(monkeypatch):
    """Two figures of a module of the test's own."""
    module = SimpleNamespace(page=lambda name, options: a_page(name, data=pd.DataFrame({"n": [options.rollouts]})))
    monkeypatch.setattr(figures, "modules", lambda: {"9.9": module, "9.10": module})


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


def test_a_page_is_its_files(tmp_path):
    folder = _page.write(a_page(), tmp_path)
    assert sorted(files(tmp_path)) == [f"9.9/{name}" for name in
                                       ("data.csv", "figure.png", "more_numbers.csv", "setting.yaml")]
    pd.testing.assert_frame_equal(study.read_table(folder / "data.csv"), a_page().data)
    assert (folder / "figure.png").read_bytes().startswith(b"\x89PNG")
    record = yaml.safe_load((folder / "setting.yaml").read_text())
    assert record["figure"] == "9.9" and record["deviations"] == ["None."]
    assert record["setting"] == {"step": 0.1, "weights": [1, 2], "deep": {"matrix": [[1.0, 0.0], [0.0, 1.0]]}}


def test_equal_pages_are_equal_bytes_whatever_stood_there(tmp_path):
    for out in (tmp_path / "first", tmp_path / "second"):
        _page.write(a_page(), out)
        _page.write_index(out)
    before = files(tmp_path / "first")
    _page.write(a_page(tables={"old": a_page().data}), tmp_path / "first")
    _page.write(a_page(), tmp_path / "first")
    _page.write_index(tmp_path / "first")
    assert before == files(tmp_path / "first") == files(tmp_path / "second")


def test_the_index_shows_all_figures_that_stand_there_in_order(tmp_path, known):
    said = []
    figures.run(["9.10"], figures.Options(rollouts=7), tmp_path, said.append)
    figures.run(["9.9", "9.9"], figures.Options(), tmp_path, said.append)
    assert sum(line.startswith("figure ") for line in said) == 2
    assert "  MISS: it falls (1 > 0)" in said
    text = (tmp_path / "index.html").read_text()
    assert re.findall(r'<section id="figure-([\d.]+)"', text) == ["9.9", "9.10"]
    assert "A line &amp; &lt;nothing&gt; else." in text
    assert text.count("1 of 3 statements missed") == 2 and "and 10 more rows" in text
    # nothing but the files of the pages is referred to
    assert set(re.findall(r'(?:src|href)="(?!data:|#)([^"]*)"', text)) == {
        f"{name}/{file}" for name in ("9.9", "9.10") for file in
        ("data.csv", "figure.png", "setting.yaml", "more_numbers.csv")}
    assert (tmp_path / "9.10" / "data.csv").read_text() == "n\n7\n"


def test_all_figures_if_none_is_named(tmp_path, known):
    figures.run([], figures.Options(), tmp_path, lambda line: None)
    assert {path.name for path in tmp_path.iterdir()} == {"9.9", "9.10", "index.html"}


@pytest.mark.parametrize("wanted, options, words", [
    (["9.9", "9.11"], figures.Options(), ["'9.11'", "9.9, 9.10"]),
    ([], figures.Options(jobs=0), ["jobs is 0"]),
    ([], figures.Options(rollouts=1), ["rollouts is 1"]),
])
def test_requests_that_make_no_sense(tmp_path, known, wanted, options, words):
    with pytest.raises(UsageError) as error:
        figures.run(wanted, options, tmp_path, print)
    assert all(word in str(error.value) for word in words)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("changes, words", [
    ({"data": pd.DataFrame({"x": []})}, ["no data"]),
    ({"tables": {"data": a_page().data}}, ["'data'"]),
    ({"tables": {"../up": a_page().data}}, ["'../up'"]),
    ({"setting": {"plant": object()}}, ["setting: plant", "object"]),
])
def test_a_page_that_is_none_leaves_the_old_one(tmp_path, changes, words):
    _page.write(a_page(), tmp_path)
    before = files(tmp_path)
    with pytest.raises(DataError) as error:
        _page.write(a_page(**changes), tmp_path)
    assert all(word in str(error.value) for word in ["9.9", *words])
    assert files(tmp_path) == before


class Broken(plots.Figure):
    def savefig(self, *args, **kwargs):
        raise OSError(28, "full")


def test_what_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        _page.write(a_page(), tmp_path / "file")
    _page.write(a_page(), tmp_path)
    before = files(tmp_path)
    with pytest.raises(OutputError, match="No space left"):
        _page.write(a_page(figure=Broken()), tmp_path)
    assert files(tmp_path) == before


@pytest.mark.parametrize("damage", ["", "figure: [", "figure: '9.9'\n", "- a\n"])
def test_a_damaged_page_is_named(tmp_path, damage):
    _page.write(a_page(), tmp_path)
    (tmp_path / "9.9" / "setting.yaml").write_text(damage)
    with pytest.raises(DataError, match=r"9\.9: not a page of a figure"):
        _page.write_index(tmp_path)


# --- 4.1 to 4.3 ---
pytest.importorskip("phri_control", reason="the workspace is not built")
from figures import _gains, _pairs, lq_gains  # noqa: E402


def neutral_oracle(setting):
    A, B, Q, R = setting.matrices()
    P = solve_discrete_are(A, B, Q, R)
    return np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)[0]


def risk_oracle(setting, root, theta):
    """Noise that one seeks risk of is a second control that shares the cost, of weight 1 / (|theta| Sigma); averse, it
    is an opponent, of negative weight."""
    A, B, Q, R = setting.matrices()
    both, weight = np.hstack([B, np.eye(2)]), np.diag([R[0, 0], *[-1.0 / (theta * root**2)] * 2])
    P = solve_discrete_are(A, both, Q, weight)
    return np.linalg.solve(weight + both.T @ P @ both, both.T @ P @ A)[0]


def cumulant_oracle(setting, roots, order, weights, printed, stages=6000, points=12, radius=4e-3):
    """No recursion over cumulants: the risk-sensitive recursion at thetas on a circle, derivatives at 0 by Cauchy's
    integral."""
    A, B, Q, R = setting.matrices()
    turn = np.exp(2j * np.pi * np.arange(points) / points)[:, None, None]
    values = [np.zeros((points, 2, 2), complex) for _ in roots]
    for _ in range(stages):
        behind = [np.linalg.solve(np.eye(2) - radius * turn * W * root**2, W) for W, root in zip(values, roots)]
        mean = sum(
            Wt.mean(0).real + (1 if printed else order) * weight * math.factorial(order - 1)
            * (Wt * turn ** (1 - order)).mean(0).real / radius ** (order - 1)
            for Wt, weight in zip(behind, weights)) / len(roots)
        gain = np.linalg.solve(R + B.T @ mean @ B, B.T @ mean @ A)
        loop = A - B @ gain
        values = [Q + gain.T @ R @ gain + loop.T @ Wt @ loop for Wt in behind]
    return gain[0]


def gains(gain):
    assert gain.status == _gains.OK
    return np.array([gain.position, gain.velocity])


@pytest.mark.parametrize("setting, digits", [(_gains.STORED, 0.99817), (_gains.PRINTED, 0.99950)])
def test_gains_of_the_expected_cost(setting, digits):
    found = gains(_gains.neutral(setting))
    np.testing.assert_allclose(found, neutral_oracle(setting), atol=GAIN_ERROR)
    assert round(found[0], 5) == digits


@pytest.mark.parametrize("setting, root", [(_gains.STORED, 1.2e-2), (_gains.PRINTED, 3e-3)])
@pytest.mark.parametrize("theta", [-0.02, -0.005, 0.005, 0.02])
def test_risk_sensitive_gains_are_those_of_a_game_against_the_noise(setting, root, theta):
    found = gains(_gains.risk_sensitive(setting, [root], [theta]))
    np.testing.assert_allclose(found, risk_oracle(setting, root, theta), atol=GAIN_ERROR)


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("printed", [True, False])
def test_cumulant_gains_are_those_of_cauchys_integral(order, printed):
    weight = 0.025**order
    roots, weights = ([1.2e-2, 6e-3], [weight, -weight]) if printed else ([1.2e-2], [-weight])
    found = gains(_gains.cumulants(_gains.STORED, roots, order, weights, printed))
    expected = cumulant_oracle(_gains.STORED, roots, order, weights, printed)
    np.testing.assert_allclose(found, expected, atol=GAIN_ERROR)


# The limit of theta tells the same as the recursion itself: a policy before it, none behind it. The margin is wider
# than the error of a finite horizon.
@pytest.mark.parametrize("setting", [_gains.STORED, _gains.PRINTED])
def test_policies_end_at_the_limit_that_is_drawn(setting):
    thetas = (0.005, 0.02)
    for theta, root in zip(thetas, _gains.breakdown_roots(setting, thetas)):
        assert _gains.risk_sensitive(setting, [0.999 * root], [theta]).status == _gains.OK
        beyond = _gains.risk_sensitive(setting, [1.001 * root], [theta])
        assert beyond.status == _gains.BREAKDOWN and math.isnan(beyond.position)


def test_a_horizon_that_is_too_short_is_doubled_or_said(monkeypatch):
    case = _gains.STORED, [1.2e-2], 2, [0.025**2], True
    expected = gains(_gains.cumulants(*case))
    monkeypatch.setattr(_gains, "FIRST_HORIZON", 5.0)
    np.testing.assert_allclose(gains(_gains.cumulants(*case)), expected, atol=GAIN_ERROR)
    monkeypatch.setattr(_gains, "LONGEST_HORIZON", 5.0)
    gain = _gains.cumulants(*case)
    assert gain.status == _gains.UNSETTLED and math.isnan(gain.position)


def test_where_the_hessian_fails_there_is_no_gain():
    gain = _gains.cumulants(_gains.PRINTED, [1.2e-2], 4, [-0.025**4], True)
    assert gain.status == _gains.BREAKDOWN and math.isnan(gain.position) and math.isnan(gain.velocity)


@pytest.fixture
def small(monkeypatch):
    """Figures of few points."""
    monkeypatch.setattr(lq_gains, "ROOTS", (0.0, 2e-3, 6e-3, 1.2e-2))
    monkeypatch.setattr(lq_gains, "COARSE_ROOTS", (0.0, 2e-3, 1.2e-2))
    monkeypatch.setattr(_pairs, "GRID_ROOTS", {_gains.STORED: (0.0, 6e-3, 1.2e-2), _gains.PRINTED: (0.0, 2e-3)})


def missed(page):
    return {line.partition("(")[0].removeprefix("MISS: ").strip() for line in page.findings if line.startswith("MISS")}


def test_figure_4_1_in_small(small, tmp_path):
    page = lq_gains.page("4.1", figures.Options())
    data = page.data
    assert len(data) == 2 * 7 * 4 and set(data["status"]) == {_gains.OK, _gains.BREAKDOWN}
    assert (data["gain_position"].isna() == (data["status"] != _gains.OK)).all()
    edge = data[data["sigma_sqrt"] == 1.2e-2].set_index(["panel", "theta"])
    assert edge.loc[("a", -0.02), "gain_position"] == pytest.approx(risk_oracle(_gains.STORED, 1.2e-2, -0.02)[0],
                                                                    abs=GAIN_ERROR)
    assert (edge.loc["b"].loc[[0.005, 0.01, 0.02], "status"] == _gains.BREAKDOWN).all()
    assert missed(page) == {"the expected cost's gain is 0.998 N/m", "averse policies exist up to Σ^1/2 = 0.012"}
    assert all("Δ = 1 ms" in line for line in page.findings if line.startswith("MISS"))
    pd.testing.assert_frame_equal(data, lq_gains.page("4.1", figures.Options(jobs=2)).data, check_exact=True)
    for out in ("first", "second"):
        _page.write(lq_gains.page("4.1", figures.Options()), tmp_path / out)
    assert files(tmp_path / "first") == files(tmp_path / "second")


def test_findings_of_wrong_curves_are_misses(small):
    thetas = (0.0, *lq_gains.THETAS, *(-theta for theta in lq_gains.THETAS))
    data = lq_gains.page("4.1", figures.Options()).data
    part = data[data["panel"] == "a"]
    swapped = {theta: part[part["theta"] == -theta] for theta in thetas}
    lines = list(lq_gains._risk_findings(swapped, 0.95, dict.fromkeys(lq_gains.THETAS, 0.1)))
    assert [line.partition(":")[0] for line in lines] == ["MISS"] * 4 + ["holds"]


def test_figure_4_2_in_small(small):
    page = lq_gains.page("4.2", figures.Options())
    assert missed(page) == {"policies exist for all weights over the whole range",
                            "at the right end a higher cumulant departs more"}
    rows = page.data[(page.data["sigma_sqrt"] == 1.2e-2) & (page.data["panel"] == "b")].set_index("weight")
    for order in (2, 3, 4):
        expected = cumulant_oracle(_gains.STORED, [1.2e-2], order, [0.025**order], False)[0]
        assert rows.loc[0.025**order, "gain_position"] == pytest.approx(expected, abs=GAIN_ERROR)
    # W's derivative of order r-1 at theta = 0 goes with Sigma^(r-1)
    assert np.allclose(page.tables["exponents"]["exponent"], 3 * [2.0, 4.0, 6.0], atol=0.01)


def test_figure_4_3_in_small(small):
    page = lq_gains.page("4.3", figures.Options())
    grid = page.data.set_index(["setting", "attitude", "sigma_sqrt_1", "sigma_sqrt_2"])["gain_position"]
    one = grid[_gains.STORED.name, "κ_3", 1.2e-2, 6e-3]
    weight = 2e-3 * math.sqrt(1e-3)
    assert one == pytest.approx(cumulant_oracle(_gains.STORED, [1.2e-2, 6e-3], 3, [weight, -weight], True)[0],
                                abs=GAIN_ERROR)
    balance = page.tables["equal_sources"].iloc[0]
    assert (balance["theta"], balance["sigma_sqrt"]) == (0.005, 2e-3)
    assert round(balance["risk_sensitive"], 5) == 1.00352 and round(balance["mean_variance"], 5) == 0.99950
    assert "equal sources balance to the expected cost, risk-sensitive" in missed(page)
    assert not any("expected cost, κ" in line for line in missed(page))
    assert "mean-variance with gamma_2 = theta/2 is almost risk-sensitive, without the factor r" in missed(page)
    # the weight of the variance is r gamma_2 (4.36) or gamma_2 (4.37): twice the one is the other
    close = page.tables["mean_variance_against_risk_sensitive"]
    np.testing.assert_allclose(close["half_theta_with_r"], close["theta_without_r"], atol=GAIN_ERROR)


def test_pages_keep_the_contract():
    for name, module in figures.modules().items():
        assert re.fullmatch(r"\d+\.\d+", name) and name in module.IDS
    names = list(figures.modules())
    assert names == sorted(names, key=figures.order) and {"3.4", "4.1", "4.10", "5.2"} <= set(names)
    with pytest.raises(dataclasses.FrozenInstanceError):
        a_page().id = "4.2"


def run(*arguments, cwd):
    command = [sys.executable, str(ROOT / "analysis" / "bin" / "phri-analysis"), "figures", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=dict(os.environ))


def test_command_line(tmp_path):
    failed = run("4.1", "4.11", cwd=tmp_path)
    assert failed.returncode == 64 and failed.stderr.count("\n") == 1
    assert "'4.11'" in failed.stderr and "4.1, 4.2, 4.3" in failed.stderr
    assert run("4.1", "--jobs", "0", cwd=tmp_path).returncode == 64
    (tmp_path / "results").write_text("in the way")
    assert run("4.1", cwd=tmp_path).returncode == 74
    done = run("4.1", "--out", tmp_path / "made", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "figure 4.1: " in done.stdout and "MISS: the expected cost's gain is 0.998 N/m (0.99950)" in done.stdout
    assert (tmp_path / "made" / "index.html").is_file()
