"""The rows of results/bench.json: what is compared with what, the arithmetic of a row, the table."""

import statistics
from dataclasses import dataclass

SAME = 1e-9  # largest relative difference between a peer's result and ours that still is the same result
BEGIN, END = "<!-- bench: begin -->", "<!-- bench: end -->"


@dataclass(frozen=True)
class Spec:
    """`ours` and `name` are keys of what bench.py and the peers measure."""

    name: str
    unit: str
    ours: str
    peers: tuple = ()
    more_is_better: bool = False


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
    Spec("trial_speed", "simulated s/s", "trial_speed", ("mujoco", "pybullet"), more_is_better=True),
)


def ratio_of(ours, peer, more_is_better):
    """How many times better ours is: above 1 in our favour."""
    return ours / peer if more_is_better else peer / ours


def spread_of(values):
    """Interquartile range over the median [-]; 0 for one value."""
    if len(values) < 2:
        return 0.0
    low, _, high = statistics.quantiles(values, n=4, method="inclusive")
    return (high - low) / abs(statistics.median(values))


def complete(spec, ours, peers, measured):
    """The rows of `spec`: one per peer, or one with peer None. `ours`: a dict per round; `measured[peer]`: the same."""
    own = [values[spec.ours] for values in ours]
    base = {"name": spec.name, "ours": statistics.median(own), "unit": spec.unit}
    there = [peers[name] for name in spec.peers if name in peers]
    if not there:
        nothing = {"peer": None, "peer_value": None, "ratio": None}
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
    return row


HEADER = ("row", "ours", "unit", "peer", "peer's", "ratio", "runs", "spread", "same result")


def cells(row):
    def number(value):
        return "-" if value is None else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"

    same = "-" if row["check"] is None else f"{row['check']:.0e}"
    return (row["name"], number(row["ours"]), row["unit"], row["peer"] or "-", number(row["peer_value"]),
            number(row["ratio"]), str(row["runs"]), f"{100 * row['spread']:.0f} %", row["reason"] or same)


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
