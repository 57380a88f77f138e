import re

import numpy as np
import pytest

import synthetic
from phri_analysis import metrics, plots, report, study, study_plots, style
from phri_analysis.errors import DataError, OutputError


@pytest.fixture(scope="module")
def kept():
    result, grid = study.Study(), synthetic.maze_grid(60)
    for participant in (1, 2):
        for controller in ("none", "lqr", "mahalanobis"):
            result.add(synthetic.plausible_trial(participant, controller, 3, grid=grid))
    result.sources.append(("one.bag", "ab" * 32))
    return result


def axes_of(figure):
    return [axes for axes in figure.axes if axes.get_visible()]


def test_every_axis_of_every_picture_has_a_unit(kept):
    for name, _, figure in report.figures(kept, kept.table()):
        figure.canvas.draw()
        for axes in axes_of(figure):
            texts = [axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left")]
            numeric = [axis.get_label_text() for axis in (axes.xaxis, axes.yaxis) if axis.get_label_text()]
            assert any(re.search(r"\[[^]]+\]", text) for text in texts) or name == "maze", (name, texts)
            assert all(re.search(r"\[[^]]+\]", text) or text == "state" for text in numeric), (name, numeric)


def test_the_prediction_picture_states_the_share_inside(kept):
    trial = kept.examples["lqr"]
    share = metrics.evaluate(trial)[0]["prediction_coverage_95"]
    title = plots.prediction_figure(trial).axes[1].get_title(loc="left")
    assert f"{100 * share:.1f} %" in title


def test_half_axes_of_an_ellipse_reach_the_95_percent_bound():
    covariance = np.array([[4e-6, 1.5e-6], [1.5e-6, 2e-6]])
    rows = synthetic.predict(synthetic.constant_trial(ticks=400), covariance=covariance)
    major, minor, angle = (value[0] for value in plots.ellipses(rows.iloc[:1]))
    for length, direction in ((major, angle), (minor, angle + np.pi / 2)):
        tip = length * np.array([np.cos(direction), np.sin(direction)])
        assert tip @ np.linalg.solve(covariance, tip) == pytest.approx(metrics.CHI2_95)


def test_pictures_survive_what_trials_may_lack(kept):
    bare = synthetic.constant_trial(ticks=50)
    for function in (plots.prediction_figure, plots.trial_figure):
        function(bare).canvas.draw()
    plots.maze_figure([bare]).canvas.draw()
    table = study.study_table([synthetic.constant_trial(ticks=1)])
    study_plots.measures_figure(table).canvas.draw()
    study_plots.subtasks_figure(table).canvas.draw()


def test_walls_land_where_the_map_says():
    # A wall in the upper left cell only: its picture must cover x in [-10, -5], y in [5, 10] mm.
    walls = {"grid": ["....", "....", "....", "#..."], "resolution": 0.005, "origin": [-0.01, -0.01]}
    picture = plots.maze_figure([synthetic.constant_trial(map=walls)]).axes[0].get_images()[0]
    assert picture.get_extent() == pytest.approx([-10, 10, -10, 10])
    opaque = picture.get_array()[..., 3]
    assert picture.origin == "lower" and opaque[3, 0] == 1.0 and opaque.sum() == 1.0
    for rows in (["..", "#"], ["..", "#x"]):
        with pytest.raises(DataError, match="grid"):
            plots.maze_figure([synthetic.constant_trial(map={**walls, "grid": rows})])


def test_a_map_that_only_names_a_picture_is_left_out():
    trial = synthetic.constant_trial(map={"image": "/nowhere/maze.png", "resolution": 1, "origin": [0, 0]})
    axes = plots.maze_figure([trial]).axes[0]
    assert axes.get_title(loc="right") == "no map in the recording" and not axes.get_images()


def test_the_report_is_self_contained_and_complete(kept, tmp_path):
    path = report.write_report(kept, tmp_path / "out", notes=[("Command", "by hand & <fast>")])
    html = path.read_text(encoding="utf-8")
    for entry in metrics.MEASURES.values():
        assert entry.heading in html or f"<td>{entry.label}</td><td>{style.shown_unit(entry.unit)}</td>" in html
        assert f"<td>{entry.label}</td><td>{style.shown_unit(entry.unit)}</td>" in html
    assert "The participants are simulated." in html and "one.bag" in html and "ab" * 32 in html
    assert "by hand &amp; &lt;fast&gt;" in html
    assert not re.search(r"(?:src|href)=\"(?!data:)|url\(|@import|<script", html)
    pictures = sorted((tmp_path / "out" / "figures").glob("*.png"))
    assert len(pictures) == html.count("data:image/png;base64,") == len(report.figures(kept, kept.table()))
    assert (tmp_path / "out" / "table.csv").is_file()


def test_the_report_does_not_claim_simulation_that_nobody_stated():
    def banner():
        return report._html(kept, kept.table(), [], "", [])

    kept = study.Study()
    kept.add(synthetic.constant_trial())
    assert "imulated" not in banner()
    kept.add(synthetic.constant_trial(participant=2, simulated_participants=True))
    assert "do not all say alike" in banner()


def test_a_limited_controller_is_marked(known_limits, tmp_path):
    kept = study.Study()
    trial = synthetic.constant_trial(controller="lqr")
    trial["limits"] = 2
    kept.add(trial)
    kept.add(synthetic.constant_trial(controller="none"))
    text = report.terminal_table(kept.table())
    assert "(b) LQR limited" in text and "(a) none limited" not in text
    assert re.search(r"Time at limit force \[%\] +0 +100\b", text)


def test_the_terminal_table_is_aligned_and_shows_the_mean_and_sd(kept):
    lines = report.terminal_table(kept.table()).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert any(line.startswith("Human power [W]") and line.count("±") == 3 for line in lines)


def test_completed_trials_are_counted_beside_the_times_of_those_that_were():
    kept = study.Study()
    kept.add(synthetic.constant_trial(ticks=2001))
    kept.add(synthetic.constant_trial(participant=2, completed=False))
    text = report.terminal_table(kept.table())
    assert re.search(r"Completed trials +1 of 2\b", text) and re.search(r"Completion time \[s\] +2\.00$", text, re.M)


def test_a_folder_that_cannot_be_made_is_an_output_error(kept, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="file"):
        report.write_report(kept, tmp_path / "file" / "out")


@pytest.mark.parametrize(
    "means, deviations, unit, expected",
    [
        ([12.92, 1.0], [1.41, float("nan")], "N", ["12.9 ± 1.4", "1.0"]),
        ([0.00345], [0.0001], "m", ["3.45 ± 0.10"]),
        ([0.947], [0.012], "share", ["94.7 ± 1.2"]),
        ([0.0, float("nan")], [0.0, float("nan")], "N", ["0", "–"]),
        ([1234.5], [10.0], "N", ["1234 ± 10"]),
    ],
)
def test_numbers_read_well(means, deviations, unit, expected):
    assert style.row_of_means(means, deviations, unit) == expected


def test_every_controller_has_its_own_look():
    names = ("none", "lqr", "mahalanobis", "pd")
    assert len({style.colour(name) for name in names}) == len({style.marker(name) for name in names}) == 4
    assert style.label("mine") == "mine" and style.colour("mine") == style.colour("mine")
    assert sorted(["zeta", "pd", "none", "lqr"], key=style.controller_order) == ["none", "lqr", "pd", "zeta"]


def test_what_was_changed_while_a_trial_ran_is_said():
    trial = synthetic.constant_trial(changes=[{"t": 1.25, "what": "pd/stiffness = 400"}])
    kept = study.Study()
    kept.add(trial)
    rows = dict(report._setting(kept, kept.table(), ()))
    assert "pd/stiffness = 400 at 1.25 s (speaks for no controller)" in rows.values()
    assert not any(key.startswith("Changed") for key, _ in report._setting(untouched(), untouched().table(), ()))


def untouched():
    kept = study.Study()
    kept.add(synthetic.constant_trial())
    return kept
