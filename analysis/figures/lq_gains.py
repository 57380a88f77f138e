"""Figures 4.1 to 4.3: stationary gains of a mass-damper over the strength of its noise (section 4.6.1)."""

import math

import numpy as np
import pandas as pd

from . import Page, _gain_pictures, _gains, _pairs, finding
from ._gains import BREAKDOWN, CONTROL, EDGE, HALF, NO_R, OK, ORDERS, PRINTED, SAME, STEP, STORED, STORED_ONE

IDS = ("4.1", "4.2", "4.3")
ROOTS = tuple(np.linspace(0.0, EDGE, 61))  # Sigma^1/2
COARSE_ROOTS = tuple(np.linspace(0.0, EDGE, 25))  # cumulants need a horizon each
THETAS = (0.005, 0.01, 0.02)  # printed in figure 4.1 [1/J]
BASE = 0.025  # of the weights of figure 4.2, stored script
SMALL = 3e-3  # Sigma^1/2 from where exponents are taken to twice as much


def page(id, options) -> Page:
    return {"4.1": _risk, "4.2": _cumulants, "4.3": _pairs.page}[id](options)


def _edges(roots):
    """The table of E[J] gains per setting, with the attitudes at the right edge."""
    rows = []
    for setting in (STORED, STORED_ONE, PRINTED):
        row = {"setting": setting.label, "source": setting.name, "expected_cost": _gains.neutral(setting).position}
        for name, gain in roots(setting):
            row[name] = gain.position
        rows.append(row)
    return pd.DataFrame(rows)


def _risk(options) -> Page:
    thetas = (*reversed(THETAS), *(-theta for theta in THETAS))
    cases = [(setting, (float(root),), (theta,)) for setting in (STORED, PRINTED) for theta in (0.0, *thetas)
             for root in ROOTS]
    gains = _gains.apply(_gains.risk_sensitive, cases, options.jobs)
    data = pd.DataFrame([
        _gains.row(gain, panel="a" if setting is STORED else "b", theta=theta, sigma_sqrt=root)
        for (setting, (root,), (theta,)), gain in zip(cases, gains)
    ])
    panels, findings, limits = [], [], []
    for panel, setting, reach in (("a", STORED, (0.75, 1.4)), ("b", PRINTED, (0.0, 3.0))):
        part = data[data["panel"] == panel]
        roots = dict(zip(THETAS, _gains.breakdown_roots(setting, THETAS)))
        limits += [{"setting": setting.label, "theta": theta, "sigma_sqrt_breakdown": root}
                   for theta, root in roots.items()]
        curves = {theta: part[part["theta"] == theta] for theta in (0.0, *thetas)}
        neutral = _gains.neutral(setting).position
        panels.append((f"({panel}) {setting.label}", neutral,
                       [(f"θ = {theta:g}", curves[theta], THETAS.index(abs(theta)), theta > 0,
                         roots.get(theta, math.nan)) for theta in thetas], reach))
        findings += [f"{line} [{setting.label}]" for line in _risk_findings(curves, neutral, roots)]
    edge = _edges(lambda setting: [(f"theta_{theta:g}", _gains.risk_sensitive(setting, [EDGE], [theta]))
                                   for theta in thetas])
    return Page(
        id="4.1",
        title="Risk-sensitive gains over the strength of one source of noise",
        thesis="Position gain of a mass-damper in an infinite horizon, over the square root of the noise covariance, "
        "for three risk-averse and three risk-seeking attitudes and the expected cost. Averse gains rise with the "
        "noise, seeking ones fall, the gain for the expected cost stays where it is; the axis ends at 0.9 and 1.1 N/m.",
        setting={"panels": {"a": STORED.record(), "b": PRINTED.record()}, "theta": list(thetas), "sources": 1,
                 "covariance": "(sigma_sqrt)^2 I on position and velocity, per step", "sigma_sqrt_max": EDGE},
        deviations=(STEP, HALF, CONTROL,
                    "A curve ends where no policy exists (cross; the vertical line is the limit by theta_max); the "
                    "thesis draws no breakdown. Pale: the range of its axis."),
        data=data,
        figure=_gain_pictures.curves(panels),
        findings=tuple(findings),
        tables={"gains_at_the_right_edge": edge, "breakdown": pd.DataFrame(limits)},
    )


def _risk_findings(curves, neutral, roots):
    still = curves[0.0]["gain_position"]
    spread = float(np.abs(still - neutral).max())
    averse = {theta: curve for theta, curve in curves.items() if theta > 0}
    seeking = {theta: curve for theta, curve in curves.items() if theta < 0}
    last = {theta: curve.dropna(subset="gain_position").iloc[-1] for theta, curve in curves.items()}

    def ends(part):
        return ", ".join(f"θ = {theta:g}: {last[theta]['gain_position']:.4f} at {last[theta]['sigma_sqrt']:.4f}"
                         for theta in part)

    yield finding(f"{neutral:.3f}" == "0.998", "the expected cost's gain is 0.998 N/m", f"{neutral:.5f}")
    yield finding(spread <= SAME, "the expected cost's gain ignores the noise", f"largest difference {spread:.1e} N/m")
    yield finding(all(_gains.monotone(curve, True) for curve in averse.values()), "averse gains rise with the noise",
                  ends(averse))
    yield finding(all(_gains.monotone(curve, False) for curve in seeking.values()), "seeking gains fall with the noise",
                  ends(seeking))
    broken = {theta: root for theta, root in roots.items() if (averse[theta]["status"] == BREAKDOWN).any()}
    yield finding(not broken, f"averse policies exist up to Σ^1/2 = {EDGE:g}",
                  "breakdown at " + ", ".join(f"{root:.5f} for θ = {theta:g}" for theta, root in roots.items()))


def _cumulants(options) -> Page:
    layout = (("a", STORED, True), ("b", STORED, False), ("c", PRINTED, True))
    weights = {order: BASE**order for order in ORDERS}
    signed = [(order, weights[order]) for order in reversed(ORDERS)] + [(order, -weights[order]) for order in ORDERS]
    cases = [(setting, (float(root),), order, (weight,), printed) for _, setting, printed in layout
             for order, weight in signed for root in COARSE_ROOTS]
    gains = _gains.apply(_gains.cumulants, cases, options.jobs)
    names = {(setting, printed): panel for panel, setting, printed in layout}
    data = pd.DataFrame([
        _gains.row(gain, panel=names[setting, printed], order=order, weight=weight, factor_r=not printed,
                   sigma_sqrt=root)
        for (setting, (root,), order, (weight,), printed), gain in zip(cases, gains)
    ])
    panels, findings, exponents = [], [], []
    for panel, setting, printed in layout:
        part = data[data["panel"] == panel]
        curves = {(order, weight > 0): part[(part["order"] == order) & (part["weight"] == weight)]
                  for order, weight in signed}
        neutral = _gains.neutral(setting).position
        label = f"{setting.label}, {'without' if printed else 'with'} factor r"
        slopes = {order: _exponent(setting, order, weights[order], printed, neutral) for order in ORDERS}
        exponents += [{"setting": label, "order": order, "exponent": slope} for order, slope in slopes.items()]
        panels.append((f"({panel}) {label}", neutral,
                       [(f"{'+' if averse else '−'} κ$_{order}$", curve, order - 2, averse, math.nan)
                        for (order, averse), curve in curves.items()],
                       (0.5, 2.0) if setting is PRINTED else (0.93, 1.05)))
        findings += [f"{line} [{label}]" for line in _cumulant_findings(curves, slopes)]
    edge = _edges(lambda setting: [(f"kappa_{order}_{'plus' if weight > 0 else 'minus'}",
                                    _gains.cumulants(setting, [EDGE], order, [weight], True))
                                   for order, weight in signed])
    return Page(
        id="4.2",
        title="Cost-cumulant gains over the strength of one source of noise",
        thesis="The gains of figure 4.1 when the expected cost plus or minus the second, third or fourth cumulant is "
        "minimised. Positive weights raise the gain, negative ones lower it, and the departure from the expected cost "
        "goes with a power of the noise that grows with the order, so that the fourth cumulant departs most at the "
        "right end.",
        setting={"panels": {panel: {**setting.record(), "factor_r": not printed} for panel, setting, printed in layout},
                 "weights": {f"kappa_{order}": weight for order, weight in weights.items()}, "sources": 1,
                 "sigma_sqrt_max": EDGE},
        deviations=(STEP, NO_R + " Panel (b) shows it.", HALF, CONTROL,
                    f"No weight is printed: ±{BASE:g}^r is that of the author's stored script. The thesis' axis (0.9 "
                    "to 1.1 N/m, pale) is wider than the curves of (a): the weights of its figure may have been "
                    "larger.",
                    "The stationary gain is the first one of a finite horizon that is doubled until it no longer "
                    "changes; a curve ends (cross) where a stage's Hessian is no longer positive or the gain does not "
                    "settle."),
        data=data,
        figure=_gain_pictures.curves(panels),
        findings=tuple(findings),
        tables={"gains_at_the_right_edge": edge, "exponents": pd.DataFrame(exponents)},
    )


def _exponent(setting, order, weight, printed, neutral):
    """Of the departure from the expected cost as a power of Sigma^1/2, where it is small."""
    small, twice = (_gains.cumulants(setting, [scale * SMALL * setting.step / STORED.step], order, [weight], printed)
                    for scale in (1.0, 2.0))
    return float(np.log2((twice.position - neutral) / (small.position - neutral)))


def _cumulant_findings(curves, slopes):
    last = {key: curve.dropna(subset="gain_position").iloc[-1] for key, curve in curves.items()}

    def ends(averse):
        return ", ".join(f"κ_{order}: {last[order, averse]['gain_position']:.4f} at "
                         f"{last[order, averse]['sigma_sqrt']:.4f}" for order in ORDERS)

    yield finding(all(_gains.monotone(curves[order, True], True) for order in ORDERS),
                  "positive weights raise the gain with the noise", ends(True))
    yield finding(all(_gains.monotone(curves[order, False], False) for order in ORDERS),
                  "negative weights lower the gain with the noise", ends(False))
    yield finding(all(abs(slope - 2 * (order - 1)) < 0.05 * slope for order, slope in slopes.items()),
                  "the departure grows with a power set by the order: Sigma^(r-1) where it is small",
                  ", ".join(f"κ_{order}: (Σ^1/2)^{slope:.3f}" for order, slope in slopes.items()))
    whole = all((curve["status"] == OK).all() for curve in curves.values())
    yield finding(whole, "policies exist for all weights over the whole range",
                  ", ".join(f"{'+' if averse else '−'}κ_{order}: {(curve['status'] == OK).mean():.0%}"
                            for (order, averse), curve in curves.items()))
    edge = [last[order, True]["gain_position"] for order in ORDERS]
    yield finding(edge[0] < edge[1] < edge[2], "at the right end a higher cumulant departs more",
                  ", ".join(f"κ_{order}: {gain:.4f}" for order, gain in zip(ORDERS, edge)))
