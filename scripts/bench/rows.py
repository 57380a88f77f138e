"""The rows of results/bench.json: what is compared with what, the arithmetic of a row, the table."""

import statistics
from dataclasses import dataclass

SAME = 1e-9  # largest relative difference between a peer's result and ours that still is the same result
BEGIN, END = "<!-- bench: begin -->", "<!-- bench: end -->"


@dataclass(frozen=True)
class Spec:
    """`ours` and `name` are keys of what bench.py and the peers measure. `aim`: the least ratio to a peer where the row
    has peers, else the largest value of ours; None: no aim."""

    name: str
    unit: str
    ours: str
    peers: tuple = ()
    more_is_better: bool = False
    aim: float | None = None


SCENES = ("point_mass", "figure_4_7", "arm", "car")
NEUTRAL = ("crocoddyl_cpp",)  # it is risk-neutral, whatever ours does


def _scene_rows(scene):
    return (
        Spec(f"{scene}_solve", "us", f"{scene}/solve", NEUTRAL),
        Spec(f"{scene}_iteration", "us", f"{scene}/solve/step", NEUTRAL),
        Spec(f"{scene}_stage", "ns", f"{scene}/backward/stage", NEUTRAL, aim=10.0 if scene == "point_mass" else None),
        Spec(f"{scene}_risk_stage", "ns", f"{scene}/risk_backward/stage", NEUTRAL, aim=4.0),
        Spec(f"{scene}_ileqr", "us", f"{scene}/ileqr", NEUTRAL, aim=3.33),
        Spec(f"{scene}_ikccr", "us", f"{scene}/ikccr", NEUTRAL, aim=1.0),
    )


ROWS = (
    Spec("tick_step_median", "ns", "tick_step_median", ("mujoco", "pybullet")),
    Spec("tick_step_p999", "ns", "tick_step_p999", ("mujoco", "pybullet")),
    Spec("tick_loop_median", "ns", "tick_tick_median"),
    Spec("tick_loop_p999", "ns", "tick_tick_p999"),
    Spec("plan_mahalanobis", "us", "plan/mahalanobis", ("crocoddyl", "numpy")),
    Spec("plan_lqr", "us", "plan/lqr", ("crocoddyl", "numpy")),
    Spec("plan_lqr_gains_kept", "us", "plan/lqr_gains_kept"),
    Spec("lq_solve", "us", "lq_solve", ("crocoddyl", "numpy")),
    Spec("prediction", "us", "prediction", ("hmmlearn",)),
    Spec("viterbi", "us", "viterbi", ("hmmlearn",)),
    *(Spec(f"viterbi_{states}", "us", f"viterbi/{states}", ("hmmlearn",), aim=80.0) for states in (10, 20, 40)),
    *(Spec(f"baum_welch_{states}", "us", f"baum_welch/{states}", ("hmmlearn",), aim=15.0) for states in (10, 20, 40)),
    Spec("recognition", "us", "recognise/primitives:50/states:10", aim=70.0),
    Spec("learning_beside_tick", "times", "learning_beside_tick"),
    Spec("learning_beside_plan", "times", "learning_beside_plan"),
    Spec("trial_speed", "simulated s/s", "trial_speed", ("mujoco", "pybullet"), more_is_better=True),
    Spec("mass_damper_stage", "ns", "mass_damper/backward/stage", NEUTRAL, aim=18.0),
    Spec("mass_damper_risk_stage", "ns", "mass_damper/risk_backward/stage", NEUTRAL, aim=4.0),
    *(row for scene in SCENES for row in _scene_rows(scene)),
    Spec("scaling_horizon_plain", "times", "scaling_horizon_plain", aim=1.1),
    Spec("scaling_horizon_risk", "times", "scaling_horizon_risk", aim=1.1),
    Spec("scaling_horizon_cumulants", "times", "scaling_horizon_cumulants", aim=1.1),
    Spec("scaling_source", "times", "scaling_source", aim=1.5),
    Spec("scaling_cumulants", "times", "scaling_cumulants", aim=2.2),
    Spec("mpc_backward", "us", "mpc_backward", aim=25.0),
    Spec("mpc_median", "us", "mpc_median"),
    Spec("mpc_p999", "us", "mpc_p999", aim=100.0),
    Spec("mpc_allocations", "allocations", "mpc_allocations", aim=0.0),
)


def scaling(passes):
    """The rows scaling_* from the times of single backward passes; each is a ratio within one round."""
    risk, cumulants = "risk_force_noise/{}/{}".format, "Cumulants/T:{}/S:2/K:{}/p:4".format

    def horizon(long, short):
        return passes[long] / 500 / (passes[short] / 50)

    return {
        "scaling_horizon_plain": horizon("lq_plain/500", "lq_plain/50"),
        "scaling_horizon_risk": horizon(risk("2_sources", 500), risk("2_sources", 50)),
        "scaling_horizon_cumulants": horizon(cumulants(500, 4), cumulants(50, 4)),
        "scaling_source": (passes[risk("3_sources", 200)] - passes[risk("1_source", 200)]) / 2
        / passes["lq_plain/200"],
        "scaling_cumulants": passes[cumulants(50, 4)] / passes[cumulants(50, 2)],
    }


def beside(times):
    """The rows learning_beside_*: 99.9th percentiles with learning beside over those without, of one run."""
    return {f"learning_beside_{what}": times[part]["learning"]["p999"] / times[part]["alone"]["p999"]
            for what, part in (("tick", "tick"), ("plan", "response"))}


def ratio_of(ours, peer, more_is_better):
    """How many times better ours is: above 1 in our favour."""
    return ours / peer if more_is_better else peer / ours


def spread_of(values):
    """Interquartile range over the median [-]; 0 for one value."""
    if len(values) < 2:
        return 0.0
    low, _, high = statistics.quantiles(values, n=4, method="inclusive")
    return (high - low) / abs(statistics.median(values)) if high > low else 0.0


def complete(spec, ours, peers, measured):
    """The rows of `spec`: one per peer, or one with peer None. `ours`: a dict per round; `measured[peer]`: the same."""
    own = [values[spec.ours] for values in ours]
    base = {"name": spec.name, "ours": statistics.median(own), "unit": spec.unit, "aim": aim_of(spec), "met": None}
    there = [peers[name] for name in spec.peers if name in peers]
    if not there:
        nothing = {"peer": None, "peer_value": None, "ratio": None}
        if spec.aim is not None and not spec.peers:
            base["met"] = base["ours"] <= spec.aim
        return [{**base, **nothing, "runs": len(own), "spread": spread_of(own), "check": None, "reason": None}]
    return [_against(spec, base, own, peer, [values.get(spec.name) for values in measured[peer.name]])
            for peer in there]


def _against(spec, base, own, peer, other):
    row = {**base, "peer": peer.version, "peer_value": None, "ratio": None, "runs": len(own),
           "spread": spread_of(own), "check": peer.checks.get(spec.name), "reason": peer.reason or None}
    if row["reason"] is None and None in other:
        row["reason"] = f"{peer.name} did not measure {spec.name}"
    if row["reason"]:
        return row
    row["peer_value"] = statistics.median(other)
    if row["check"] is not None and not row["check"] <= SAME:
        row["reason"] = f"another result: it differs by {row['check']:.1e} of ours"
        return row
    ratios = [ratio_of(mine, theirs, spec.more_is_better) for mine, theirs in zip(own, other)]
    row["ratio"], row["spread"] = statistics.median(ratios), spread_of(ratios)
    if spec.aim is not None:
        row["met"] = row["ratio"] >= spec.aim
    return row


def aim_of(spec):
    return None if spec.aim is None else f"{'ratio >=' if spec.peers else 'ours <='} {spec.aim:g}"


def missed(rows):
    """A line per aim that was measured and not met."""
    return [f"aim missed: {row['name']}: {row['aim']}, measured "
            f"{row['ours'] if row['ratio'] is None else row['ratio']:.3g}" for row in rows if row["met"] is False]


HEADER = ("row", "ours", "unit", "peer", "peer's", "ratio", "aim", "runs", "spread", "same result")


def cells(row):
    def number(value):
        return "-" if value is None else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"

    aim = "-" if row["aim"] is None else row["aim"] + {None: "", True: ": met", False: ": missed"}[row["met"]]
    same = "-" if row["check"] is None else f"{row['check']:.0e}"
    return (row["name"], number(row["ours"]), row["unit"], row["peer"] or "-", number(row["peer_value"]),
            number(row["ratio"]), aim, str(row["runs"]), f"{100 * row['spread']:.0f} %", row["reason"] or same)


def table(rows):
    lines = [HEADER, *map(cells, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEADER) - 1)]
    return "\n".join("  ".join([*(cell.ljust(width) for cell, width in zip(line, widths)), line[-1]]).rstrip()
                     for line in lines)


def markdown(result):
    about = result["machine"]
    lines = [
        f"{about['processor']}, {about['cores']} cores, {about['memory']}; {about['kernel']}; {about['compiler']};",
        f"load average before: {about['load_before']}; revision {about['revision']}. {result['rounds']} rounds of at "
        f"least {result['seconds']} s per quantity.",
        "",
        "| " + " | ".join(HEADER) + " |",
        "|" + "---|" * len(HEADER),
        *("| " + " | ".join(cells(row)) + " |" for row in result["rows"]),
    ]
    return "\n".join(lines)


def write_docs(page, result):
    """Rewrites what stands between the markers of `page`; ValueError without them."""
    text = page.read_text(encoding="utf-8")
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{page} has no lines {BEGIN} and {END}")
    page.write_text(f"{before}{BEGIN}\n{markdown(result)}\n{END}{after}", encoding="utf-8")
