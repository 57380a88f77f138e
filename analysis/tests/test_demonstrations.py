"""Demonstrations from files: every documented form reads back, and what is wrong is said with file and cause."""

import numpy as np
import pytest
import scipy.io

from phri_analysis import demonstrations
from phri_analysis.errors import DataError, MissingInputError


def curve(samples=60, phase=0.0, dimension=2):
    u = np.linspace(0.0, 1.0, samples)
    return np.stack([np.sin(2 * u + phase + j) for j in range(dimension)], axis=1)


def write_lasa(path, count=3, unit=1000.0, **changes):
    """A file in the nested form of the official release: demos is a 1 x N cell array of 1 x 1 structs whose fields are
    (2, T) and (1, T)."""
    cells = np.empty((1, count), dtype=object)
    for i in range(count):
        x = unit * curve(phase=0.1 * i).T
        t = np.linspace(0.0, 2.0, x.shape[1])[None]
        v = np.gradient(x, t[0], axis=1)
        demo = {"pos": x, "t": t, "vel": v, "acc": np.gradient(v, t[0], axis=1), "dt": float(t[0, 1])}
        demo.update({key: value(x, t) for key, value in changes.items()})
        cells[0, i] = {key: value for key, value in demo.items() if value is not None}
    scipy.io.savemat(path, {"demos": cells, "dt": 0.03})


def test_lasa_files_become_movements_in_metres(tmp_path):
    folder = tmp_path / "DataSet"
    folder.mkdir()
    for name in ("WShape", "Angle"):
        write_lasa(folder / f"{name}.mat")
    for path in (folder, tmp_path):
        movements = demonstrations.load(path)
        assert [movement.name for movement in movements] == ["Angle", "WShape"]
        for movement in movements:
            assert len(movement.demonstrations) == 3
            for i, demo in enumerate(movement.demonstrations):
                assert demo.x == pytest.approx(curve(phase=0.1 * i), abs=1e-12)
                assert demo.t[-1] == 2.0
    assert len(demonstrations.load(folder / "Angle.mat")) == 1


def test_a_single_demonstration_in_a_cell_reads_as_one(tmp_path):
    write_lasa(tmp_path / "One.mat", count=1)
    (movement,) = demonstrations.load(tmp_path / "One.mat")
    assert movement.demonstrations[0].x.shape == (60, 2)


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"pos": lambda x, t: None}, "'pos'"),
        ({"t": lambda x, t: t[:, :-1]}, "59 times"),
        ({"t": lambda x, t: -t}, "falls"),
        ({"pos": lambda x, t: np.where(x == x.max(), np.nan, x)}, "finite"),
    ],
)
def test_broken_lasa_files_name_demonstration_and_cause(tmp_path, changes, said):
    path = tmp_path / "Bad.mat"
    write_lasa(path, **changes)
    with pytest.raises(DataError, match=said) as error:
        demonstrations.load(path)
    assert "Bad.mat: demos{1}" in str(error.value)


def test_other_mat_files_and_damaged_ones_are_refused(tmp_path):
    scipy.io.savemat(tmp_path / "other.mat", {"x": np.zeros(3)})
    with pytest.raises(DataError, match="found: x"):
        demonstrations.load(tmp_path / "other.mat")
    write_lasa(tmp_path / "cut.mat")
    whole = (tmp_path / "cut.mat").read_bytes()
    for size in (0, 60, 200, len(whole) // 2, len(whole) - 8):
        (tmp_path / "cut.mat").write_bytes(whole[:size])
        with pytest.raises(DataError, match="cut.mat"):
            demonstrations.load(tmp_path / "cut.mat")


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_a_folder_holds_one_demonstration_per_file(tmp_path, suffix):
    for i in range(2):
        x, t = curve(dimension=3, phase=i), 0.01 * np.arange(60)
        if suffix == "csv":
            text = "\n".join(",".join(repr(float(v)) for v in row) for row in np.column_stack([t, x]))
            (tmp_path / f"{i}.csv").write_text("t, x, y, z\n" + text + "\n")
        else:
            np.savez(tmp_path / f"{i}.npz", t=t, pos=x)
    (movement,) = demonstrations.load(tmp_path)
    for i, demo in enumerate(movement.demonstrations):
        assert (demo.x == curve(dimension=3, phase=i)).all()


def test_numbered_arrays_with_one_sampling_time(tmp_path):
    path = tmp_path / "move.npz"
    np.savez(path, Ts=0.01, **{f"pos_{i}": curve(60 + i) for i in range(11)})
    (movement,) = demonstrations.load(path)
    assert [len(demo.t) for demo in movement.demonstrations] == list(range(60, 71))  # 10 comes after 9, not after 1
    assert movement.demonstrations[0].t[-1] == pytest.approx(0.59)
    np.savez(path, pos_0=curve())
    with pytest.raises(DataError, match="Ts"):
        demonstrations.load(path)
    np.savez(path, pos_0=curve(), Ts=-1.0)
    with pytest.raises(DataError, match="positive"):
        demonstrations.load(path)
    np.savez(path, pos_0=curve(), pos_1=curve(dimension=3), Ts=0.01)
    with pytest.raises(DataError, match="3 dimensions, expected 2"):
        demonstrations.load(path)


def test_absent_empty_and_mixed_paths(tmp_path):
    for path in (tmp_path / "absent", tmp_path):
        with pytest.raises(MissingInputError):
            demonstrations.load(path)
    (tmp_path / "a.csv").write_text("a,b\n1,2\n")
    with pytest.raises(DataError, match="expected t, x, y"):
        demonstrations.load(tmp_path)
    np.savez(tmp_path / "b.npz", t=np.arange(9.0), pos=np.zeros((9, 2)))
    with pytest.raises(DataError, match="side by side"):
        demonstrations.load(tmp_path)
    (tmp_path / "a.csv").unlink()
    with pytest.raises(DataError, match="9 samples"):
        demonstrations.load(tmp_path)
    with pytest.raises(DataError, match="unknown kind"):
        (tmp_path / "x.txt").write_text("")
        demonstrations.load(tmp_path / "x.txt")


def test_resampling_keeps_straight_lines_and_drops_repeated_times():
    t = np.array([0.0, 0.1, 0.1, 0.35, 1.0, *np.arange(1.1, 2.0, 0.1)])
    demo = demonstrations._demonstration("d", t, np.column_stack([2.0 * t, 1.0 - t]))
    assert len(demo.t) == len(t) - 1
    x = demo.resampled(0.02)
    assert x[:, 0] == pytest.approx(0.04 * np.arange(len(x)), abs=1e-12)
    assert len(x) == 1 + round((t[-1] - t[0]) / 0.02)
