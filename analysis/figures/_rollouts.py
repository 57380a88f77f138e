"""Does an attitude to risk pay in the true cost? Statistics of stochastic roll-outs, and policies compared in pairs.

    table = compare(scene, results, attitudes, rollouts=10_000, seed=1)

Estimates: mean, variance, third and fourth cumulant by k-statistics (scipy.stats.kstat), which are unbiased for any
distribution. Intervals of these, of criteria and of their paired differences: jackknife, value +- z s / sqrt(n) with s
the standard deviation of the pseudo-values n f - (n - 1) f_without_i. It is deterministic and linear in n, and a paired
difference is one of pseudo-values. For the higher cumulants of skewed costs it is too short: of a gamma distribution
of shape 4 and 10^4 runs, intervals "of 95 %" cover kappa_3 in 92 % and kappa_4 in 90 % of cases. Shares of collisions:
Wilson (statsmodels); their paired difference: Agresti and Min (2005), Wald with half a run added to each of the four
outcomes.

Every interval is of its own: of many panels at 95 %, one in twenty "pays" or "costs" by chance.
"""

import numpy as np
import pandas as pd
from phri_analysis.errors import DataError
from scipy import special, stats
from statsmodels.stats.proportion import proportion_confint

LEVEL = 0.95
PAYS, COSTS, SAME, REFERENCE = "pays", "costs", "no difference", "reference"
UNUSABLE, DIVERGES = "no policy", "diverges"
# a cost that no task has: the run is lost, whether it ends in a NaN or just before
LOST = 1e30
# a criterion that rests on fewer runs than this says more about the seed than about the policy
LEAST_WEIGHT = 100.0

ESTIMATES = ("mean", "variance", "kappa_3", "kappa_4", "criterion")  # of one policy, with _low and _high
SHARES = ("collisions", "collisions_moving", "collisions_static", "diverged", "better")  # of runs, with _low and _high
DIFFERENCES = ("mean", "variance", "criterion", "collisions")  # d_NAME with _low and _high: policy minus reference
VERDICTS = ("mean", "variance", "collisions")  # verdict_NAME of these differences; of d_criterion: verdict


def k_statistics(costs) -> np.ndarray:
    """Unbiased estimates of the first four cumulants."""
    costs = np.asarray(costs, float)
    centre = costs.mean()  # kstat adds up raw powers: without the shift, small spreads of large costs cancel
    return np.array([centre, *(stats.kstat(costs - centre, order) for order in (2, 3, 4))])


def leave_one_out(costs) -> np.ndarray:
    """(4, n): the k-statistics without run i, from power sums."""
    costs = np.asarray(costs, float)
    centre, scale = costs.mean(), costs.std()
    if not scale > 0.0:
        return np.stack([costs, *np.zeros((3, len(costs)))])
    z = (costs - centre) / scale  # cumulants from the second on do not see the shift; sums of size n do not cancel
    n = len(z) - 1.0
    z2 = z * z
    s1, s2, s3, s4 = (power.sum() - power for power in (z, z2, z2 * z, z2 * z2))
    q = s1 * s1
    k2 = (n * s2 - q) / (n * (n - 1))
    k3 = (2 * q * s1 - 3 * n * s1 * s2 + n * n * s3) / (n * (n - 1) * (n - 2))
    k4 = -6 * q * q + 12 * n * q * s2 - 3 * n * (n - 1) * s2 * s2 - 4 * n * (n + 1) * s1 * s3 + n * n * (n + 1) * s4
    k4 /= n * (n - 1) * (n - 2) * (n - 3)
    return np.stack([centre + scale * s1 / n, scale**2 * k2, scale**3 * k3, scale**4 * k4])


def exponential(costs, theta: float) -> tuple:
    """theta^-1 log mean exp(theta J), the same without run i (n,), and how many runs carry it: (sum w)^2 / sum w^2."""
    costs = np.asarray(costs, float)
    n = len(costs)
    if theta == 0.0:
        return costs.mean(), (costs.sum() - costs) / (n - 1), float(n)
    exponents = theta * costs
    largest, top = exponents.max(), exponents.argmax()
    weights = np.exp(exponents - largest)
    total = weights.sum()
    rest = np.empty(n)
    others = np.arange(n) != top
    rest[others] = np.log(total - weights[others]) + largest
    rest[top] = special.logsumexp(exponents[others])  # it may be all of the total
    return (np.log(total / n) + largest) / theta, (rest - np.log(n - 1)) / theta, float(total**2 / (weights**2).sum())


class Estimate:
    """A statistic with its jackknife. Estimates over the same runs can be added, scaled and subtracted."""

    def __init__(self, value, without, weight=np.inf):
        self.value, self.without, self.weight = value, without, weight

    def __add__(self, other):
        return Estimate(self.value + other.value, self.without + other.without, min(self.weight, other.weight))

    def __mul__(self, factor):
        return Estimate(factor * self.value, factor * self.without, self.weight)

    def __sub__(self, other):
        return self + other * -1.0

    def limits(self, level=LEVEL) -> tuple:
        n = len(self.without)
        error = np.sqrt((n - 1) / n * np.sum((self.without - self.without.mean()) ** 2))
        reach = stats.norm.ppf(0.5 + 0.5 * level) * error
        return self.value - reach, self.value + reach


def cumulants(costs) -> list:
    """Estimates of kappa_1 .. kappa_4."""
    return [Estimate(value, without) for value, without in zip(k_statistics(costs), leave_one_out(costs))]


def criterion(attitude, costs: list) -> Estimate:
    """The attitude's own criterion, the mean over its sources; `costs` of runs with that source alone, source by
    source."""
    thetas = getattr(attitude, "theta", None)
    sources = len(costs)
    if thetas is not None:
        parts = [Estimate(*exponential(runs, theta)) for runs, theta in zip(costs, thetas)]
    else:
        parts = []
        for runs, weights in zip(costs, attitude.gamma):
            kappa = cumulants(runs)
            if len(weights) + 1 > len(kappa):
                raise DataError(f"criterion: weights up to kappa_{len(weights) + 1}, expected up to kappa_{len(kappa)}")
            parts.append(kappa[0])
            for weight, cumulant in zip(weights, kappa[1:]):
                parts[-1] += cumulant * weight
    total = parts[0]
    for part in parts[1:]:
        total += part
    return total * (1.0 / sources)


def share(flags, level=LEVEL) -> tuple:
    """Share of runs with the Wilson interval: (value, low, high)."""
    flags = np.asarray(flags, bool)
    low, high = proportion_confint(flags.sum(), len(flags), alpha=1.0 - level, method="wilson")
    return flags.mean(), float(low), float(high)


def share_difference(flags, others, level=LEVEL) -> tuple:
    """Difference of two shares over the same runs: (value, low, high)."""
    flags, others = np.asarray(flags, bool), np.asarray(others, bool)
    n = len(flags) + 2.0
    more, less = (flags & ~others).sum() + 0.5, (~flags & others).sum() + 0.5
    centre = (more - less) / n
    reach = stats.norm.ppf(0.5 + 0.5 * level) * np.sqrt((more + less) / n - centre**2) / np.sqrt(n)
    return flags.mean() - others.mean(), centre - reach, centre + reach


def verdict(low: float, high: float) -> str:
    """Of a difference to the reference in something that should be small, from its interval."""
    if np.isnan(low) or np.isnan(high):
        return DIVERGES
    return PAYS if high < 0.0 else COSTS if low > 0.0 else SAME


class Runs:
    """Roll-outs of one policy: with all sources, and with each alone."""

    def __init__(self, scene, policy, rollouts: int, seed: int):
        from phri_control import roll_out

        self.all = roll_out(scene, policy, rollouts, seed=seed)
        sources = len(scene.noise)
        moving = self.all.distances.shape[1] - len(scene.static_obstacles)
        # where one source is all the noise there is, its runs are those of all
        alone = [self.all]
        if sources > 1:
            alone = [roll_out(scene, policy, rollouts, seed=seed, source=s) for s in range(sources)]
        self.alone = [runs.model_costs for runs in alone]
        hits = self.all.distances < 1.0
        lost = ~(np.abs(self.all.costs) < LOST)
        self.costs = np.where(lost, np.inf, self.all.costs)
        self.flags = {
            "collisions": hits.any(axis=1),
            "collisions_moving": hits[:, :moving].any(axis=1),
            "collisions_static": hits[:, moving:].any(axis=1),
            "diverged": lost,
        }

    def better(self, other) -> np.ndarray:
        """Which runs cost less than the other policy's, of those in which the two differ."""
        differ = self.costs != other.costs
        return (self.costs < other.costs)[differ]


def compare(
    scene, results: dict, attitudes: dict, rollouts: int = 10_000, seed: int = 1, reference=None
) -> pd.DataFrame:
    """One row per panel: how its policy does in `rollouts` simulations of the true dynamics and the true cost.

    `scene` is a PlanarScene (thesis_scene(...).scene), `results` maps panel -> IterativeResult of scene.solve(attitude)
    in the joint state, `attitudes` maps panel -> the attitude it was solved for (FigurePanel.attitude). `reference` is
    the risk-neutral result that the policies are compared with, run by run on the same noise; None: scene.solve().

    Index: panel. Columns, each of ESTIMATES, SHARES and d_ + DIFFERENCES with NAME_low and NAME_high (95 %):
      mean .. kappa_4  of the true cost with all noise, static things at places drawn (`costs` of the roll-outs)
      criterion        the attitude's own: mean over the sources of theta^-1 log mean exp(theta J), or of the weighted
                       cumulants, each source alone (`model_costs`: what the attitude does not weigh is averaged). It is
                       the whole attitude's also where the result is of a reduced one (`share` < 1)
      weight           runs that the criterion rests on, at most `rollouts`; nan for cumulants
                       Mean to criterion are nan where a run diverges, alone too for the criterion: they do not exist
      collisions       share of runs that enter an obstacle's width; _moving and _static obstacles apart
      diverged         share of runs whose cost is not finite or beyond LOST
      better           share of runs that cost less than the reference on the same noise, of those that differ
      median           of the cost; diverged runs count as infinite
      clearance        median over the runs of the smallest distance in widths; nan without obstacles
      d_...            policy minus reference: below 0, the policy is better
      verdict          of d_criterion: "pays", "costs", "no difference" (its interval contains 0, or `weight` of the
                       policy or the reference is below LEAST_WEIGHT); "diverges" where runs of either do, "reference"
                       where the result is the reference or the attitude is neutral, "no policy" where it is not usable
                       (all else nan)
      verdict_mean, verdict_variance, verdict_collisions   of those differences
      share            of the attitude that the result belongs to
    """
    from_neutral = Runs(scene, scene.solve() if reference is None else reference, rollouts, seed)
    rows = {}
    for panel, result in results.items():
        rows[panel] = {"share": result.share} if result.usable else {"verdict": UNUSABLE, "share": result.share}
        if not result.usable:
            continue
        same = result is reference or neutral(attitudes[panel])
        runs = Runs(scene, result, rollouts, seed)
        rows[panel] |= _row(attitudes[panel], runs, from_neutral, same)
    columns = []
    for name in (*ESTIMATES, *SHARES, *(f"d_{name}" for name in DIFFERENCES)):
        columns += [name, f"{name}_low", f"{name}_high"]
    columns += ["weight", "median", "clearance", "share", "verdict", *(f"verdict_{name}" for name in VERDICTS)]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("panel")


def neutral(attitude) -> bool:
    """The attitude asks for the mean alone."""
    weights = getattr(attitude, "theta", None)
    return not np.any(attitude.gamma if weights is None else weights)


def _row(attitude, runs: Runs, other: Runs, same: bool) -> dict:
    row = {}

    def put(name, value, low, high):
        row.update({name: value, f"{name}_low": low, f"{name}_high": high})

    nothing = Estimate(np.nan, np.full(len(runs.costs), np.nan))

    def estimates(policy):
        """Cumulants and own criterion."""
        whole = np.isfinite(policy.costs).all()
        alone = all((np.abs(costs) < LOST).all() for costs in policy.alone)
        kappa = cumulants(policy.costs) if whole else [nothing] * 4
        return [*kappa, criterion(attitude, policy.alone) if alone else nothing]

    own, others = estimates(runs), estimates(other)
    for name, estimate in zip(ESTIMATES, own):
        put(name, estimate.value, *estimate.limits())
    for name, one, two in zip(ESTIMATES, own, others):
        if name in DIFFERENCES:
            put(f"d_{name}", (one - two).value, *(one - two).limits())
    for name, flags in runs.flags.items():
        put(name, *share(flags))
    if len(better := runs.better(other)):
        put("better", *share(better))
    put("d_collisions", *share_difference(runs.flags["collisions"], other.flags["collisions"]))
    weight = min(own[-1].weight, others[-1].weight)
    row["weight"] = weight if np.isfinite(weight) else np.nan
    row["median"] = np.median(runs.costs)
    clearance = np.median(runs.all.clearance)
    row["clearance"] = clearance if np.isfinite(clearance) else np.nan
    for name in DIFFERENCES:
        word = REFERENCE if same else verdict(row[f"d_{name}_low"], row[f"d_{name}_high"])
        row["verdict" if name == "criterion" else f"verdict_{name}"] = word
    if row["verdict"] in (PAYS, COSTS) and weight < LEAST_WEIGHT:
        row["verdict"] = SAME
    return row
