"""A library of movement primitives from demonstrations of one's own: `phri-analysis learn DATA`.

Every demonstration is a segment; with `segment`, long recordings are first cut by the on-line segmentation (the fixed
setting of the study `segmentation`: where the distribution of the velocity changes). Segments become samples
[p; v] or, where there are forces, [p; v; f] every DT, and go one by one into a PrimitiveLibrary with the options of the
thesis (10 states, 3 members make a primitive).
- An axis that moves less than STILL of what the widest one moves is left out: it would only add its noise.
- v is the slope of a parabola through 5 samples (0.2 s), so not causal: for training only.
- f is the mean of the DT before; what it is expressed in is the recording's affair (see bag_demonstrations).

What is alike is relative: segments make a primitive when they are nearer to each other than `cutoff` times the mean
distance of all. So where all demonstrations are of one movement, a part of them, or none, becomes one.

Cross-validation: within every primitive, and every movement that files hold together, each segment is left out once,
and the positions 0.3 s ahead are predicted from the others, exactly as in the study `prediction` (50 Hz, positions
alone). Which segments make a primitive was decided with all of them: the numbers speak of prediction, not recognition.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import savgol_filter

from studies import _page, prediction, segmentation

from . import bag_demonstrations, demonstrations, primitive_plots
from .bags import find_bags
from .demonstrations import AXES, Movement
from .errors import DataError, UsageError

DT = segmentation.DT  # [s] of the samples, 20 Hz as the learner
STATES, MEMBERS = 10, 3  # of the thesis
CUTOFF = 0.6  # segments of a primitive are nearer than this times the mean distance of all
STILL = 0.02
SMOOTHING = 5  # samples of a parabola
DECIMALS = 9  # of m, m/s and N: beyond are rounding errors, from which a model of an axis at rest would be made
FEWEST = 10  # samples of a segment
PRIMITIVE, GIVEN = "primitive", "movement"  # kinds of groups
HORIZON = prediction.HORIZONS[-1] * prediction.DT  # [s] of what is printed
METHODS = (prediction.DEFAULT, prediction.VELOCITY, prediction.NEAREST)


@dataclass(frozen=True)
class Segment:
    """Part of a demonstration from `start` to `end` [s]. `samples` (T, d). `follows`: right after the one before."""

    movement: str
    demonstration: demonstrations.Demonstration
    start: float
    end: float
    samples: np.ndarray
    follows: bool = False

    def positions(self, axes) -> demonstrations.Demonstration:
        """What was recorded of it."""
        demo, since = self.demonstration, self.demonstration.t - self.demonstration.t[0]
        inside = (since >= self.start - 1e-9) & (since <= self.end + 1e-9)
        return replace(demo, t=demo.t[inside], x=demo.x[inside][:, axes], force=None)


def gather(paths, pose: str = "", wrench: str = "") -> tuple:
    """(movements, notes) of files and folders, all of the same dimensions. Raises UsageError, DataError,
    MissingInputError."""
    movements, notes, bags = [], [], False
    for path in map(Path, paths):
        if not bag_demonstrations.is_bag(path):
            movements += demonstrations.load(path)
            continue
        bags = True
        for bag in find_bags([path]):
            demos, said = bag_demonstrations.read(bag, pose, wrench)
            movements.append(Movement(bag.stem, tuple(demos)))
            notes += said
    if (pose or wrench) and not bags:
        raise UsageError("--pose and --wrench name topics of bags, and no bag is given")
    # the same check as within a movement
    demonstrations.movement(Path("all"), [demo for movement in movements for demo in movement.demonstrations])
    return movements, notes


def moving_axes(movements) -> list:
    """Indices of the axes that move."""
    reach = np.max([np.ptp(demo.x, axis=0) for movement in movements for demo in movement.demonstrations], axis=0)
    if reach.max() <= 0.0:
        raise DataError(f"{movements[0].demonstrations[0].name}: nothing moves, expected positions that change")
    return [int(i) for i in np.flatnonzero(reach >= STILL * reach.max())]


def samples(demo, axes) -> np.ndarray:
    """[p; v] or [p; v; f], (T, d)."""
    x = demo.resampled(DT)[:, axes]
    if len(x) < FEWEST:
        raise DataError(f"{demo.name}: {len(x) * DT:.2f} s long, expected at least {FEWEST * DT:.2f} s")
    parts = [x, savgol_filter(x, SMOOTHING, 2, deriv=1, delta=DT, axis=0)]
    parts += [] if demo.force is None else [demo.resampled_force(DT)[:, axes]]
    return np.round(np.hstack(parts), DECIMALS)


def segments(movements, axes, cut: bool) -> tuple:
    """(segments, how many pieces were too short to be one)."""
    found, short = [], 0
    for movement in movements:
        for demo in movement.demonstrations:
            whole = samples(demo, axes)
            cuts = [0, len(whole)]
            if cut:
                velocities = np.diff(whole[:, : len(axes)], axis=0) / DT
                cuts = sorted({*cuts, *(boundary.index for boundary in segmentation.online(velocities))})
            follows = False
            for begin, end in zip(cuts, cuts[1:]):
                if end - begin < FEWEST:
                    short, follows = short + 1, False
                    continue
                until = end * DT if end < len(whole) else demo.t[-1] - demo.t[0]
                found.append(Segment(movement.name, demo, begin * DT, until, whole[begin:end], follows))
                follows = True
    return found, short


def build(parts, cutoff: float = CUTOFF):
    """The library of segments. Raises DataError when there are too few for a primitive."""
    import phri_learning

    if len(parts) < MEMBERS:
        raise DataError(
            f"{parts[0].demonstration.name if parts else 'no segment'}: {len(parts)} segment(s) in all, expected at "
            f"least {MEMBERS} that are alike; more demonstrations are needed, or --segment where one recording holds "
            "many"
        )
    library = phri_learning.PrimitiveLibrary(states=STATES, dt=DT, members=MEMBERS, cutoff=cutoff)
    for part in parts:
        try:
            library.add(part.samples, part.follows)
        except ValueError as error:
            raise DataError(f"{part.demonstration.name}: nothing can be learned from it: {error}") from None
    return library


def groups(library, parts, cut: bool) -> list:
    """(kind, name, indices of its segments): the primitives, then, if nothing was cut, the movements as the files have
    them, but for those that are a primitive."""
    found = []
    for node in library.upper_nodes:
        found.append((PRIMITIVE, str(node), [i for i in range(len(parts)) if library.primitive_of(i) == node]))
    if not cut:
        known = [indices for _, _, indices in found]
        for name in dict.fromkeys(part.movement for part in parts):
            indices = [i for i, part in enumerate(parts) if part.movement == name]
            if len(indices) > 1 and indices not in known:
                found.append((GIVEN, name, indices))
    return found


def cross_validate(grouped, parts, axes, jobs: int = 1) -> tuple:
    """(table as of the study `prediction` with the kind of the group; how many segments were too short to judge)."""
    movements, kinds, short = [], {}, set()
    for kind, name, indices in grouped:
        positions = {i: parts[i].positions(axes) for i in indices}
        long_enough = [demo for demo in positions.values() if len(demo.times(prediction.DT)) >= prediction.FEWEST]
        short |= {i for i, demo in positions.items() if len(demo.times(prediction.DT)) < prediction.FEWEST}
        if len(long_enough) >= 2:
            movements.append(Movement(f"{kind} {name}", tuple(long_enough)))
            kinds[f"{kind} {name}"] = kind
    if not movements:
        return pd.DataFrame(columns=["kind", "movement"]), len(short)
    table = prediction.evaluate(movements, jobs, METHODS).drop(columns="length_error")
    table.insert(0, "kind", table["movement"].map(kinds))
    return table, len(short)


def text_rows(library, grouped, parts, table) -> tuple:
    """(header, rows) of text: a group per row, after each kind its mean."""
    header = ["Group", "seen", "length [s]", "from", *[f"{method} [mm]" for method in METHODS], "inside 95 %"]
    rows = []
    for kind in (PRIMITIVE, GIVEN):
        for _, name, indices in (group for group in grouped if group[0] == kind):
            where = Counter(parts[i].movement for i in indices)
            names = ", ".join(f"{movement} {count}" for movement, count in where.most_common(3))
            more = f", {len(where) - 3} more" if len(where) > 3 else ""
            mean = np.mean([parts[i].end - parts[i].start for i in indices])
            length = library.node(int(name)).length if kind == PRIMITIVE else mean
            rows.append([f"{kind} {name}", str(len(indices)), f"{length:.1f}", names + more,
                         *_numbers(table[table["movement"] == f"{kind} {name}"])])  # fmt: skip
        if sum(group[0] == kind for group in grouped) > 1:
            rows.append([f"mean of {kind}s", "", "", "", *_numbers(table[table["kind"] == kind])])
    return header, rows


def _numbers(table):
    if not len(table):
        return ["-"] * (len(METHODS) + 1)
    means = prediction.summary(table).xs(HORIZON, level="horizon")
    errors = [f"{means.loc[method, 'error_mm']:.2f}" for method in METHODS]
    return [*errors, f"{100 * means.loc[prediction.DEFAULT, 'coverage']:.1f} %"]


def run(paths, out, pose: str = "", wrench: str = "", cut: bool = False, cutoff: float = CUTOFF, jobs: int = 1) -> list:
    """Writes library.json, table.csv, segments.csv, library.png, demonstrations.png and session.yaml into the folder
    `out`; returns the lines to print."""
    if jobs < 1:
        raise UsageError(f"jobs is {jobs}, expected 1 or more")
    if not 0.0 < cutoff < 1.0:
        raise UsageError(f"cutoff is {cutoff}, expected between 0 and 1")
    out = Path(out)
    movements, notes = gather(paths, pose, wrench)
    axes = moving_axes(movements)
    parts, short = segments(movements, axes, cut)
    library = build(parts, cutoff)
    grouped = groups(library, parts, cut)
    table, unjudged = cross_validate(grouped, parts, axes, jobs)
    notes += [_data_note(movements, parts, axes),
              f"Library: {len(library.upper_nodes)} primitive(s), {len(library.node(0).segments)} segment(s) in none."]
    if short:
        notes.append(f"{short} piece(s) between cuts shorter than {FEWEST * DT} s are left out.")
    if unjudged:
        notes.append(f"{unjudged} segment(s) shorter than {prediction.FEWEST * prediction.DT:.2f} s are not judged.")
    if not library.upper_nodes:
        notes.append(f"No {MEMBERS} segments are nearer to each other than {cutoff} of the mean distance (--cutoff).")
    header, rows = text_rows(library, grouped, parts, table)
    _write(out, library, parts, table, {
        "data": [str(path) for path in paths],
        "pose": pose, "wrench": wrench, "axes": axes, "dt": DT, "states": STATES, "members": MEMBERS, "cutoff": cutoff,
        "smoothing": SMOOTHING, "segmentation": dict(segmentation.SETTING) if cut else None,
        "prediction_dt": prediction.DT, "horizon": HORIZON,
    })  # fmt: skip
    judged = ["", _page.aligned(header, rows), "", f"Errors {HORIZON:.1f} s ahead, one segment left out in turn."]
    return [
        *notes, *(judged if len(table) else []), f"library:  {out / 'library.json'}",
        f"tables:   {out / 'table.csv'}, segments.csv", f"pictures: {out / 'library.png'}, demonstrations.png",
    ]  # fmt: skip


def _data_note(movements, parts, axes):
    first = movements[0].demonstrations[0]
    what = "positions and velocities" if first.force is None else "positions, velocities and forces"
    still = first.x.shape[1] - len(axes)
    count = sum(len(movement.demonstrations) for movement in movements)
    return (
        f"Data: {count} demonstration(s), {len(parts)} segment(s) of {what} in "
        f"{', '.join(AXES[i] if i < len(AXES) else str(i) for i in axes)}"
        + (f" ({still} axis left out: it hardly moves)" if still else "") + f", every {DT} s."
    )  # fmt: skip


def _write(out, library, parts, table, record):
    listed = pd.DataFrame([
        {"segment": i, "movement": part.movement, "demonstration": part.demonstration.name, "start": part.start,
         "end": part.end, "primitive": library.primitive_of(i)} for i, part in enumerate(parts)
    ])  # fmt: skip
    places = [(part.positions(record["axes"]).x, library.primitive_of(i)) for i, part in enumerate(parts)]
    for name, figure in (("library", primitive_plots.picture(library)),
                         ("demonstrations", primitive_plots.segments(library, places))):  # fmt: skip
        _page.write_file(out / f"{name}.png", _page.png(figure, 110))
    _page.write_csv(table, out / "table.csv")
    _page.write_csv(listed, out / "segments.csv")
    _page.write_record(out, "learn", record)
    library.to_json(str(out / "library.json"))
