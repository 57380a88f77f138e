"""The study of contact tasks: what it counts, and that it says so when a statement of the thesis does not show."""

import pandas as pd
import pytest

from studies import contact as study

ADAPTED = ("neutral_adapted", "seeking_adapted")


def table(verdict, seeds=4, limited=0.0):
    """`verdict(part, controller, displacement)` for every seed."""
    rows = []
    for task, displacements in (("button", (0.0, 0.05, 0.10)), ("whiteboard", (-0.05, 0.0, 0.05))):
        for displacement in displacements:
            for controller in study.LETTERS:
                for seed in range(seeds):
                    parts = {part: verdict(part, controller, displacement) for part in study.PARTS[task]}
                    rows.append({"task": task, "displacement": displacement, "controller": controller, "seed": seed,
                                 "repeated_demonstrations": 0, "limited": limited, "deepest": 0.004,
                                 "pointing_error": 0.001, "wiped": 1.0, "peak_force": 10.0, **parts})  # fmt: skip
    return pd.DataFrame(rows)


def as_in_the_thesis(part, controller, displacement):
    moved = displacement != 0.0
    if part == "pressing":
        return "failure" if moved and controller == "neutral_learned" else "success"
    if part == "pointing":
        return "failure" if moved and controller in ADAPTED else "success"
    return "partial" if moved and controller != "seeking_learned" else "success"


def test_counts_are_of_every_cell():
    counted = study.counts(table(as_in_the_thesis))
    assert len(counted) == 3 * 3 * len(study.LETTERS)
    assert (counted[list(study.VERDICTS)].sum(axis=1) == 4).all()
    cell = counted[(counted["part"] == "pressing") & (counted["displacement"] == 0.10)].set_index("controller")
    assert list(cell.loc["neutral_learned", list(study.VERDICTS)]) == [0, 0, 4]
    assert study.scores(counted)["wiping", "neutral_adapted"] == pytest.approx((1.0 + 2 * 0.5) / 3)


def test_every_statement_of_the_thesis_is_recognised():
    found = study.claims(study.counts(table(as_in_the_thesis)))
    assert len(found) == 7
    assert all(shown for _, shown, _ in found)


def test_equal_controllers_show_nothing_of_it():
    found = study.claims(study.counts(table(lambda *_: "success")))
    shown = {statement for statement, seen, _ in found if seen}
    assert shown == {"(a) and (b) do not", "(b) erases the text in all conditions"}


@pytest.mark.parametrize("part, controller, lost", [
    ("pressing", "seeking_learned", "(b) presses the button better than (a)"),
    ("pressing", "seeking_adapted", "(c) and (d) press it better than (a)"),
    ("pointing", "seeking_learned", "(a) and (b) do not"),
    ("wiping", "seeking_learned", "(b) erases the text in all conditions"),
])  # fmt: skip
def test_one_worse_controller_is_a_miss(part, controller, lost):
    found = study.claims(study.counts(table(
        lambda p, c, d: "failure" if (p, c) == (part, controller) else as_in_the_thesis(p, c, d))))  # fmt: skip
    assert lost in [statement for statement, seen, _ in found if not seen]


def test_one_success_beside_the_place_is_enough_to_miss():
    rows = table(as_in_the_thesis)
    lucky = (rows["controller"] == "neutral_adapted") & (rows["displacement"] == 0.05) & (rows["seed"] == 2)
    rows.loc[lucky & (rows["task"] == "button"), "pointing"] = "success"
    found = study.claims(study.counts(rows))
    assert [statement for statement, seen, _ in found if not seen] == [
        "(c) and (d) point beside the place when the button was displaced"]  # fmt: skip


def test_limited_controllers_are_marked():
    header, rows = study.count_rows(study.counts(table(as_in_the_thesis, limited=0.06)))
    assert len(rows) == 9 and all(len(row) == len(header) for row in rows)
    assert all(cell.endswith(" limited") for row in rows for cell in row[2:])
    _, rows = study.count_rows(study.counts(table(as_in_the_thesis, limited=0.05)))
    assert rows[2][2] == "0 / 0 / 4"
    header, rows = study.measure_rows(table(as_in_the_thesis))
    assert len(rows) == 30 and all(len(row) == len(header) for row in rows)


def test_picture_has_a_panel_per_part_and_condition():
    fig = study.picture(study.counts(table(as_in_the_thesis)))
    titles = [axes.get_title(loc="left") or axes.get_title() for axes in fig.axes]
    assert [title for title in titles if title] == [
        "pressing, +0 cm", "pressing, +5 cm", "pressing, +10 cm", "pointing, +0 cm", "pointing, +5 cm",
        "pointing, +10 cm", "wiping, -5 cm", "wiping, +0 cm", "wiping, +5 cm"]  # fmt: skip
    heights = [bar.get_height() for bar in fig.axes[2].patches]
    assert sum(heights) == pytest.approx(len(study.LETTERS))


def test_runs_with_the_library():
    pytest.importorskip("phri_sim")
    small = (("controllers", ["seeking_learned"]), ("displacements", [0.05]), ("demonstrations", 3))
    rows = study.measure(1, 1, False, small, ("button",))
    assert len(rows) == 1
    row = rows.iloc[0]
    assert row["pressing"] in study.VERDICTS and row["pointing"] in study.VERDICTS
    assert (row["pressing"] == "success") == (row["clicks"] > 0)
    assert not row["faulted"]
