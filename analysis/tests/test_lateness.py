"""Lateness of ticks, from the bag to the report."""

import re
from pathlib import Path

import numpy as np
import pytest

import bag_writer
import synthetic
from phri_analysis import bags, lateness, report, study
from phri_analysis.errors import DataError

LOOP = Path(__file__).resolve().parents[2] / "catkin_ws" / "src" / "phri_sim" / "ros" / "realtime_loop.hpp"


def late_trial(values, **attrs):
    trial = synthetic.constant_trial(ticks=len(values), clock="realtime", **attrs)
    trial["lateness"] = np.array(values, dtype=float)
    return trial


def test_the_bins_are_those_of_the_node():
    edges = re.search(r"kEdges = \{([^}]*)\}", LOOP.read_text())[1]
    assert tuple(float(edge) for edge in edges.split(",")) == lateness.EDGES


def test_every_tick_is_in_its_bin():
    # the same ticks, bins and counts as LatenessHistogram's own test
    result = lateness.summary([late_trial([0.0, 50e-6, 51e-6, 0.9e-3, 19e-3, 21e-3, 5.0])])
    assert result.counts == (2, 1, 0, 0, 1, 0, 0, 1, 2)
    assert (result.ticks, result.worst, result.slipped) == (7, 5.0, 19 + 21 + 5000)


def test_quantiles_are_values_that_occurred():
    values = np.random.default_rng(3).permutation(np.arange(1, 1001) / 1e6)
    result = lateness.summary([late_trial(values[:400]), late_trial(values[400:])])
    assert result.quantiles == {"p50": 500 / 1e6, "p99": 990 / 1e6, "p99.9": 999 / 1e6}
    assert sum(result.counts) == result.ticks == 1000 and result.slipped == 1
    assert "p99.9 0.999 ms, worst 1.000 ms, 1 slipped" in result.line()
    assert re.search(r"<= 0.05 ms +50 +5.000 %", result.table())


def test_lateness_comes_out_of_the_bag_for_real_time_trials_only(tmp_path):
    trial = late_trial(np.linspace(0, 1e-3, 300))
    read = bags.read_trial(bag_writer.write_bag(trial, tmp_path / "a.bag"))
    assert read["lateness"].equals(trial["lateness"])
    trial.attrs["clock"] = "lockstep"
    read = bags.read_trial(bag_writer.write_bag(trial, tmp_path / "b.bag"))
    assert "lateness" not in read
    with pytest.raises(DataError, match="'lockstep', expected a recording of a real-time trial"):
        lateness.summary([read])


def test_a_bag_of_before_ticks_had_a_lateness_is_read(tmp_path, monkeypatch):
    """The message as it was: without the field, under the same name."""
    trial = synthetic.constant_trial(ticks=300, clock="realtime")
    whole = bag_writer.message_class("Tick")._full_text
    old = "\n".join(line for line in whole.splitlines() if "lateness" not in line)
    former = bag_writer.generate_dynamic("phri_msgs/Tick", old)["phri_msgs/Tick"]
    make = bag_writer.message_class
    monkeypatch.setattr(bag_writer, "message_class", lambda name: former if name == "Tick" else make(name))
    read = bags.read_trial(bag_writer.write_bag(trial, tmp_path / "a.bag"))
    assert read.equals(trial) and "lateness" not in read
    with pytest.raises(DataError, match="recorded before bags held it"):
        lateness.summary([read])


def test_the_report_shows_it_for_real_time_trials():
    kept, other = study.Study(), study.Study()
    other.add(late_trial([1e-4] * 600 + [3e-3], participant=2))
    kept.add(synthetic.constant_trial(ticks=600))
    table = kept.table()
    assert "lateness" not in [name for name, _, _ in report.figures(kept, table)]
    kept.merge(other)
    pictures = {name: figure for name, _, figure in report.figures(kept, kept.table())}
    pictures["lateness"].canvas.draw()
    title = pictures["lateness"].axes[0].get_title(loc="left")
    assert title == "601 ticks: p50 0.100 ms, p99 0.100 ms, p99.9 3.000 ms, worst 3.000 ms, 3 slipped"
    assert title in report._html(kept, kept.table(), [], "", [])
    # measured or not, the measures are the same
    assert list(kept.table().columns) == list(table.columns)
