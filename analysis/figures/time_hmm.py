"""Figures 3.4 to 3.6: time-based HMM of a petal, prediction across primitives, learning over repetitions (3.1.3)."""

import concurrent.futures

import numpy as np
import pandas as pd
import phri_learning

from phri_analysis import demonstrations
from studies import prediction

from . import Page, _flower, _hmm_pictures, _primitives, finding
from ._primitives import DT, HORIZON, MEMBERS, STATES, WINDOW, WINDOW_STATES

IDS = ("3.4", "3.5", "3.6")
PEOPLE, REPETITIONS = 6, 15
SUBJECT, PART = 1, 0  # of figures 3.4 and 3.5: a person, a petal
HELD_OUT = 5  # repetitions that judge the regions of figure 3.4
AFTER = 1.0  # [s] after a transition
JUMP = 0.02  # [m], the gate of section 5.1.1
PANDA = "Panda, symbol 17"
SYNTHETIC = (
    "The thesis' recordings of six people are not public. Ours are seeded synthetic people on a path like that of "
    "figure 3.3: own pace, size and place, slower where the path bends, forces M xddot + D xdot with M = 40 kg and "
    "D = 90 Ns/m. They are smoother than people with a haptic device: errors are smaller, and constant velocity is a "
    "strong rival; their forces carry no noise."
)


def page(id, options) -> Page:
    return {"3.4": _output, "3.5": _window, "3.6": _learning}[id](options)


def _person(**more):
    return {"people": "synthetic, seeded", "mass": _flower.MASS, "damping": _flower.DAMPING,
            "seconds_per_repetition": _flower.SECONDS, "wander": _flower.WANDER, "dt": DT, **more}  # fmt: skip


def _panda():
    """Six trials of one movement, [p; v] every DT."""
    (movement,) = demonstrations.load(prediction.SHIPPED)
    positions = [demo.resampled(DT) for demo in movement.demonstrations]
    return [np.hstack([x, np.gradient(x, DT, axis=0)]) for x in positions]


def _output(options) -> Page:
    pieces = _flower.person(SUBJECT, REPETITIONS, DT).pieces(PART)
    sets = {_flower.PARTS[PART]: (pieces[:-HELD_OUT], pieces[-HELD_OUT:]), PANDA: (_panda(), [])}
    frames, rows, models = [], [], {}
    for name, (train, held_out) in sets.items():
        model = phri_learning.TimeHmm(STATES, dt=DT).fit(train)
        times = np.arange(0.0, model.length_, DT)
        mean, full = model.regress(times)
        _, printed = model.regress(times, full_covariance=False)
        models[name] = (train, times, mean, full, model.means_)
        columns = ["x", "y", "vx", "vy", "fx", "fy"][: mean.shape[1]]
        frame = pd.DataFrame({"set": name, "t": times})
        for j, column in enumerate(columns):
            frame[column] = mean[:, j]
            frame[f"{column}_sd"] = np.sqrt(full[:, j, j])
            frame[f"{column}_sd_printed"] = np.sqrt(printed[:, j, j])
        frames.append(frame)
        steps = [np.linalg.norm(np.diff(x[:, :2], axis=0), axis=1).max() for x in train]
        bends = [np.linalg.norm(np.diff(x[:, :2], 2, axis=0), axis=1).max() for x in train]
        stairs = np.linalg.norm(np.diff(model.means_[:, :2], axis=0), axis=1).max()
        rows.append({
            "set": name, "demonstrations": len(train), "length": model.length_,
            "mean_length": DT * np.mean([len(x) for x in train]),
            "largest_step_mm": 1e3 * np.linalg.norm(np.diff(mean[:, :2], axis=0), axis=1).max(),
            "of_demonstrations_mm": 1e3 * max(steps), "of_state_means_mm": 1e3 * stairs,
            "largest_bend_mm": 1e3 * np.linalg.norm(np.diff(mean[:, :2], 2, axis=0), axis=1).max(),
            "bend_of_demonstrations_mm": 1e3 * max(bends),
            "inside_full": _inside(held_out, mean, full), "inside_printed": _inside(held_out, mean, printed),
        })  # fmt: skip
    table = pd.DataFrame(rows)
    petal = table.iloc[0]
    findings = [finding(row.largest_step_mm <= row.of_demonstrations_mm,
                        f"the output is smooth without post-processing, no step larger than the data's [{row.set}]",
                        f"{row.largest_step_mm:.2f} mm, data {row.of_demonstrations_mm:.2f} mm, means of the states in "
                        f"turn {row.of_state_means_mm:.1f} mm") for row in table.itertuples()]  # fmt: skip
    findings += [finding(row.largest_bend_mm <= row.bend_of_demonstrations_mm,
                         f"and no corner sharper than the data's (second difference) [{row.set}]",
                         f"{row.largest_bend_mm:.2f} mm, data {row.bend_of_demonstrations_mm:.2f} mm")
                 for row in table.itertuples()]  # fmt: skip
    findings.append(
        f"Not in the thesis: of {HELD_OUT} repetitions left out {petal.inside_full:.0%} of the positions lie in the "
        f"95 % ellipses, {petal.inside_printed:.0%} with (3.6) as printed, without the spread of times between them.")
    return Page(
        id="3.4",
        title="Generalised output of a petal's time-based HMM",
        thesis="Output of the primitive of the bottom petal for one subject: the explicit time makes the regressed "
        "trajectory smooth, without post-processing.",
        setting=_person(person=SUBJECT, states=STATES, components=1, trained_on=len(pieces) - HELD_OUT,
                        held_out=HELD_OUT, panda="analysis/tests/data/panda_comanip, [p; v], all six trials"),
        deviations=(SYNTHETIC, "The petals lie between the axes; ours is the first one, lower right. It was cut where "
                    "it begins and ends, not by the segmentation.",
                    "Panel (d) is a real movement of another robot, shipped with the tests: a person guides it, trials "
                    "last 5 to 18 s, so the output in time is that of no single trial."),
        data=pd.concat(frames),
        figure=_hmm_pictures.output(models, _flower.PARTS[PART], PANDA),
        findings=tuple(findings),
        tables={"smoothness": table},
    )


def _inside(held_out, mean, covariance):
    """Share of the held-out positions in the 95 % ellipses of their times."""
    shares = [prediction.inside(x[: len(mean), :2] - mean[: len(x), :2], covariance[: len(x), :2, :2])
              for x in held_out]  # fmt: skip
    return float(np.concatenate(shares).mean()) if shares else np.nan


def _window(options) -> Page:
    run = _flower.person(SUBJECT, REPETITIONS, DT)
    found = _primitives.followed(_primitives.taught(run, REPETITIONS - 1), run, REPETITIONS)
    error = {way: np.linalg.norm(found[way] - found["ahead"], axis=1) for way in ("window", "own")}
    cuts = np.concatenate([[0.0], found["t"][1:][np.diff(found["part"]) != 0]])  # it begins with one
    near = np.any((found["t"][:, None] >= cuts) & (found["t"][:, None] < cuts + AFTER), axis=1)
    step = {way: np.linalg.norm(np.diff(found[way], axis=0), axis=1).max() for way in error}
    real = np.linalg.norm(np.diff(found["ahead"], axis=0), axis=1).max()
    rows = [{"way": name, "error_mm": 1e3 * error[way].mean(), "after_transitions_mm": 1e3 * error[way][near].mean(),
             "elsewhere_mm": 1e3 * error[way][~near].mean(), "largest_mm": 1e3 * error[way].max(),
             "largest_step_mm": 1e3 * step[way]}
            for way, name in (("window", "window HMM"), ("own", "likeliest node alone"))]  # fmt: skip
    jumps = [error["own"][(found["t"] >= cut) & (found["t"] < cut + AFTER)].max() for cut in cuts]
    with_, alone = rows
    data = pd.DataFrame({"t": found["t"], "part": [_flower.PARTS[i] for i in found["part"]], "node": found["node"]})
    for way in ("x", "ahead", "window", "own"):
        data[[f"{way}_x", f"{way}_y"]] = found[way]
    return Page(
        id="3.5",
        title="Prediction 0.3 s ahead across primitives, with and without window HMM",
        thesis="One execution of the task with all primitives known: with the window HMM the predicted position stays "
        "close to the later one, without it five big jumps follow the transitions between primitives, where the "
        "likeliest node is still the last one.",
        setting=_person(person=SUBJECT, states=STATES, members=MEMBERS, window=WINDOW, window_states=WINDOW_STATES,
                        horizon=HORIZON, taught=REPETITIONS - 1, predicted_repetition=REPETITIONS, blend=0,
                        recognition_of_the_window="motion", recognition_without="all"),
        deviations=(SYNTHETIC, "The parts were cut where they begin and end, so that all primitives are known and the "
                    "figure shows the window alone.",
                    "Both ways use the entry-corrected time for (3.8); the library's blending of changes is off.",
                    "\"Without\" is the model of the node that the last 30 samples are likeliest under; the window HMM "
                    "way is the library's partner, whose change of primitive waits for 3 samples."),
        data=data,
        figure=_hmm_pictures.window(found, error, cuts),
        findings=(
            finding(with_["error_mm"] < alone["error_mm"], "the window HMM improves the prediction",
                    f"mean error {with_['error_mm']:.2f} mm, without {alone['error_mm']:.2f} mm"),
            finding(min(jumps) > JUMP, f"without it every transition is followed by a jump (error above {JUMP} m)",
                    f"{sum(jump > JUMP for jump in jumps)} of {len(jumps)}: "
                    + ", ".join(f"{1e3 * jump:.0f}" for jump in jumps) + " mm"),
            finding(alone["after_transitions_mm"] > 2.0 * alone["elsewhere_mm"],
                    f"without it errors stand in the {AFTER:g} s after transitions",
                    f"{alone['after_transitions_mm']:.2f} mm there, {alone['elsewhere_mm']:.2f} mm elsewhere; with it "
                    f"{with_['after_transitions_mm']:.2f} and {with_['elsewhere_mm']:.2f} mm"),
            finding(with_["largest_step_mm"] < alone["largest_step_mm"], "the window HMM's predictions are smoother",
                    f"largest step {with_['largest_step_mm']:.1f} mm, without {alone['largest_step_mm']:.1f} mm, of "
                    f"the motion {1e3 * real:.1f} mm"),
        ),
        tables={"errors": pd.DataFrame(rows)},
    )  # fmt: skip


def _learning(options, people: int = PEOPLE, repetitions: int = REPETITIONS) -> Page:
    seeds, references = range(1, people + 1), ("path", "displacement")
    tasks = [(seed, repetitions, reference) for reference in references for seed in seeds]
    if options.jobs == 1:
        runs = [_primitives.online(*task) for task in tasks]
    else:
        with concurrent.futures.ProcessPoolExecutor(options.jobs) as pool:
            runs = list(pool.map(_primitives.online, *zip(*tasks)))
    data = pd.DataFrame([
        {"reference": reference, "person": run["person"], "repetition": k, "error_mm": 1e3 * run["error"][mine].mean(),
         "mse_mm2": 1e6 * (run["error"][mine] ** 2).mean(), "predicted": run["predicted"][mine].mean(),
         "velocity_error_mm": 1e3 * run["velocity_error"][mine].mean(), "primitives": run["primitives"][k - 1]}
        for (_, _, reference), run in zip(tasks, runs) for k in range(1, repetitions + 1)
        for mine in [run["repetition"] == k]
    ])  # fmt: skip
    path = data[data["reference"] == "path"]
    means = path.groupby("repetition")["error_mm"].agg(["mean", "std"])
    moved = data[data["reference"] == "displacement"].groupby("repetition")["error_mm"].mean()
    primitives = path.groupby("repetition")["primitives"].mean()
    first = path[path["primitives"] > 0].groupby("person")["repetition"].min()
    last, best = primitives.iloc[-1], int(means["mean"].idxmin())
    straight = path.groupby("repetition")["velocity_error_mm"].mean()
    segments = np.mean([run["segments"] for run in runs[:people]]) / repetitions
    before, after = means["mean"].loc[: MEMBERS + 1].mean(), means["mean"].loc[MEMBERS + 2 :]
    middle = means["std"].loc[5:11].mean()
    return Page(
        id="3.6",
        title="Prediction error over repetitions while learning",
        thesis="Mean over six subjects, 15 repetitions: the error begins to fall after the fourth repetition, for a "
        "node needs three members, and is smallest after twelve; between the fifth and eleventh the subjects differ "
        "much. There are usually five branches, one for each part of the task.",
        setting=_person(people_count=people, repetitions=repetitions, states=STATES, members=MEMBERS, window=WINDOW,
                        window_states=WINDOW_STATES, horizon=HORIZON, segmentation="the library's default"),
        deviations=(SYNTHETIC, "Where nothing is predicted yet, the present position counts as prediction: the thesis "
                    "does not say what it did. Learning is done before the next sample.",
                    "The axis of the thesis says MSE, its text mean prediction error; the picture shows the mean "
                    "distance, the data both.",
                    "Beside the thesis' reference to the path stand the library's displacement form and constant "
                    "velocity, judged on the same samples."),
        data=data,
        figure=_hmm_pictures.learning(data, MEMBERS),
        findings=(
            finding(bool(len(after)) and after.max() < before, "the error falls after the fourth repetition",
                    f"mean of the first {MEMBERS + 1} {before:.2f} mm, largest later one {after.max():.2f} mm"),
            finding(first.min() > MEMBERS, f"no node before repetition {MEMBERS + 1}",
                    "first node known at the end of repetition " + ", ".join(map(str, first))),
            finding(best >= 12, "the error is smallest after twelve repetitions",
                    f"{means['mean'].loc[best]:.2f} mm in repetition {best}, last {means['mean'].iloc[-1]:.2f} mm"),
            finding(middle > means["std"].loc[12:].mean(), "people differ most between repetitions 5 and 11",
                    f"standard deviation {middle:.2f} mm, later {means['std'].loc[12:].mean():.2f} mm"),
            finding(abs(last - 5.0) < 1.0, "about five branches",
                    f"{last:.1f} upper nodes on average after {segments:.1f} segments per repetition"),
            f"Not in the thesis: in the last repetition {means['mean'].iloc[-1]:.2f} mm, displacement form "
            f"{moved.iloc[-1]:.2f} mm, constant velocity {straight.iloc[-1]:.2f} mm.",
        ),
        tables={"means": pd.DataFrame({"repetition": means.index, "error_mm": means["mean"].values,
                                       "spread_mm": means["std"].values, "displacement_mm": moved.values,
                                       "primitives": primitives.values})},
    )  # fmt: skip
