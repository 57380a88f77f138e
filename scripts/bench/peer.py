"""What the programs peer_<name>.py share: the conversation with bench.py, and how a call is timed.

A peer is started once with the case file as its argument. It prints one line of JSON, {"version": text, "checks":
{row: difference}} where a difference is the largest relative one between the peer's result and ours; then it answers
every line of standard input, {"seconds": budget}, with one line {row: value}. Its standard error is its log.
"""

import json
import sys
import time


def read_case():
    with open(sys.argv[1], encoding="utf-8") as file:
        return json.load(file)


def serve(version, checks, measure):
    """`measure(seconds)` -> {row: value} is called once per round."""
    print(json.dumps({"version": version, "checks": checks}), flush=True)
    for line in sys.stdin:
        print(json.dumps(measure(json.loads(line)["seconds"])), flush=True)


def mean_time(call, seconds):
    """Mean CPU time of this thread per call [us], over at least `seconds`, as Google Benchmark counts ours."""
    calls, batch = 0, 1
    call()
    start = time.thread_time()
    while (elapsed := time.thread_time() - start) < seconds:
        for _ in range(batch):
            call()
        calls += batch
        batch = min(2 * batch, 1000)
    return 1e6 * elapsed / calls


def percentiles(nanoseconds, clock):
    """Of single calls [ns], less the cost of reading the clock, as bench_tick prints them."""
    values = sorted(nanoseconds)
    count = len(values)
    return {
        "tick_step_median": values[int(0.5 * count)] - clock,
        "tick_step_p999": values[min(int(0.999 * count), count - 1)] - clock,
    }


def difference(peer, ours):
    """Largest difference over the largest element of ours [-]."""
    import numpy as np

    peer, ours = np.asarray(peer, dtype=float), np.asarray(ours, dtype=float)
    if peer.shape != ours.shape:
        return float("inf")
    return float(np.abs(peer - ours).max() / np.abs(ours).max())
