"""Many bags make the same study however many are read at once; unreadable ones are named, never dropped silently."""

import bag_writer
import pytest
import synthetic

from phri_analysis import recorded
from phri_analysis.errors import DataError


@pytest.fixture
def files(tmp_path):
    made = []
    for participant in (1, 2):
        for trial in (1, 2):
            table = synthetic.plausible_trial(participant, "lqr", trial, 7)
            short = table.iloc[:400].reset_index(drop=True)
            short.attrs = table.attrs
            made.append(bag_writer.write_bag(short, tmp_path / f"p{participant}_t{trial}.bag"))
    return made


def test_the_study_does_not_depend_on_how_many_are_read_at_once(files):
    one, two = (recorded.read_study(files, jobs) for jobs in (1, 2))
    assert one.table().equals(two.table())
    assert one.sources == two.sources and [name for name, _ in one.sources] == [path.name for path in files]
    assert [track.attrs["participant"] for track in two.tracks] == [1, 1, 2, 2]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_damaged_bag_stops_the_report_or_is_named_in_it(files, jobs):
    content = files[1].read_bytes()
    files[1].write_bytes(content[: len(content) // 2])
    with pytest.raises(DataError, match=files[1].name):
        recorded.read_study(files, jobs)
    kept = recorded.read_study(files, jobs, skip_bad=True)
    assert [name for name, _ in kept.skipped] == [files[1].name] and len(kept.sources) == 3


def test_nothing_readable_is_an_error(tmp_path):
    (tmp_path / "a.bag").write_bytes(b"no bag")
    with pytest.raises(DataError, match="none of the 1 bags"):
        recorded.read_study([tmp_path / "a.bag"], skip_bad=True)


def test_ratings_are_found_beside_the_bags(tmp_path):
    (tmp_path / "session.yaml").write_text(
        "state: complete\nratings:\n- {participant: 0, controller: pd, trial: 2, rating: 5}\n"
        "- {participant: 0, controller: lqr, trial: 2, rating: 2}\n"
        "- {participant: 0, controller: lqr, trial: 3, changed: true, rating: 6}\n"
        "- {participant: 1, controller: pd, trial: 2, rating: 4}\n"
    )
    found = recorded.ratings([tmp_path / "a.bag", tmp_path / "b.bag"])
    assert found == [("changed", [6]), ("lqr", [2]), ("pd", [5, 4])]
    (tmp_path / "session.yaml").write_text("{broken")
    assert recorded.ratings([tmp_path / "a.bag"]) == []
    assert recorded.ratings([tmp_path / "nowhere" / "a.bag"]) == []
