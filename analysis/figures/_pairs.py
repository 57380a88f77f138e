"""Figure 4.3: gains of a mass-damper with two sources of noise, one judged averse, the other seeking."""

import math

import numpy as np
import pandas as pd

from . import Page, _gain_pictures, _gains, finding
from ._gains import CONTROL, EDGE, HALF, NO_R, OK, ORDERS, PRINTED, SAME, STEP, STORED

THETA, BASE = 0.002, math.sqrt(1e-3)  # stored script, which rounds the base of the cumulants' weights to 0.03163
GRID_ROOTS = {STORED: tuple(np.linspace(0.0, EDGE, 13)), PRINTED: tuple(np.linspace(0.0, EDGE, 7))}
AGREES = 0.1  # share of the effect within which two attitudes count as almost the same


def page(options) -> Page:
    weights = {order: 2.0 * BASE**order for order in ORDERS}
    kinds = ("risk-sensitive", *(f"κ_{order}" for order in ORDERS))
    cases = [(setting, (float(first), float(second)), kind) for setting in (STORED, PRINTED) for kind in kinds
             for first in GRID_ROOTS[setting] for second in GRID_ROOTS[setting]]
    gains = _gains.apply(_pair, cases, options.jobs)
    data = pd.DataFrame([
        _gains.row(gain, setting=setting.name, panel="abcd"[kinds.index(kind)], attitude=kind, sigma_sqrt_1=first,
                   sigma_sqrt_2=second)
        for (setting, (first, second), kind), gain in zip(cases, gains)
    ])
    rows, findings = [], []
    neutral = {setting: _gains.neutral(setting).position for setting in (STORED, PRINTED)}
    for setting in (STORED, PRINTED):
        parts = {kind: data[(data["setting"] == setting.name) & (data["attitude"] == kind)] for kind in kinds}
        titles = ("(a) risk-sensitive", *(f"({'bcd'[order - 2]}) E[J] ± κ$_{order}$" for order in ORDERS))
        rows.append((setting.label, neutral[setting], list(zip(titles, parts.values())),
                     0.032 if setting is STORED else 1.0))
        findings += [f"{line} [{setting.label}]" for line in _findings(parts, neutral[setting])]
    balance, close = _balance(), _closeness()
    printed = balance[(balance["setting"] == PRINTED.label) & (balance["theta"] == 0.005)].iloc[0]
    findings.append(
        finding(abs(printed["risk_sensitive"] - printed["expected_cost"]) <= SAME,
                "equal sources with opposite theta give the expected cost's gain, risk-sensitive",
                f"{printed['risk_sensitive']:.5f} against {printed['expected_cost']:.5f}; mean-variance "
                f"{printed['mean_variance']:.5f}; θ = ±0.005, Σ^1/2 = 0.002, {PRINTED.label}"))
    findings += _closeness_findings(close)
    return Page(
        id="4.3",
        title="Gains of two sources of noise, one averse, one seeking",
        thesis="Position gain over the square roots of two equal kinds of noise, the first judged averse and the "
        "second seeking with the same weight: risk-sensitive (a) and the second, third and fourth cumulant (b to d). "
        "The first raises the gain, the second lowers it, and equal ones are said to balance to the expected cost's "
        "0.998 N/m; the fourth cumulant goes furthest at the ends, mean-variance is said to be almost the same as "
        "risk-sensitive for small theta and gamma_2 = theta/2.",
        setting={"rows": {setting.name: setting.record() for setting in (STORED, PRINTED)},
                 "theta": [THETA, -THETA],
                 "weights": {f"kappa_{order}": [weight, -weight] for order, weight in weights.items()},
                 "factor_r": False, "sources": 2, "sigma_sqrt_max": EDGE},
        deviations=(STEP, NO_R + " With gamma_2 = theta it is then what (4.36) is with gamma_2 = theta/2.", HALF,
                    CONTROL, "No attitude is printed: θ = ±0.002 and weights ±2 (0.001)^(r/2) are those of the "
                    "author's stored script.",
                    "Maps of the difference to the expected cost's gain in place of surfaces; a cross is a pair of "
                    "covariances without a policy, or whose gain does not settle (data.csv tells which); colours end "
                    "where the bar does. The lower row has fewer points."),
        data=data,
        figure=_gain_pictures.maps(rows),
        findings=tuple(findings),
        tables={"equal_sources": balance, "mean_variance_against_risk_sensitive": close},
    )


def _pair(setting, roots, kind):
    if kind == "risk-sensitive":
        return _gains.risk_sensitive(setting, roots, (THETA, -THETA))
    order = int(kind[-1])
    weight = 2.0 * BASE**order
    return _gains.cumulants(setting, roots, order, (weight, -weight), True)


def _findings(parts, neutral):
    for wanted, statement, index, other in ((True, "the gain rises with the averse source", "sigma_sqrt_1", "2"),
                                            (False, "the gain falls with the seeking source", "sigma_sqrt_2", "1")):
        curves = {kind: [curve.sort_values(index) for _, curve in part.groupby(f"sigma_sqrt_{other}")
                         if curve["gain_position"].count() > 1] for kind, part in parts.items()}
        rising = {kind: sum(_gains.monotone(curve, wanted) for curve in lines) for kind, lines in curves.items()}
        yield finding(all(rising[kind] == len(lines) for kind, lines in curves.items()), statement,
                      ", ".join(f"{kind}: {rising[kind]} of {len(lines)} lines" for kind, lines in curves.items()))
    exists = {kind: (part["status"] == OK).mean() for kind, part in parts.items()}
    yield finding(min(exists.values()) == 1.0, "a policy exists for every pair of covariances",
                  ", ".join(f"{kind}: {share:.0%}" for kind, share in exists.items()))
    for kind, part in parts.items():
        equal = part[(part["sigma_sqrt_1"] == part["sigma_sqrt_2"]) & (part["status"] == OK)]
        worst = (equal["gain_position"] - neutral).abs().max()
        yield finding(worst <= 1e-6 * neutral, f"equal sources balance to the expected cost, {kind}",
                      f"largest difference {worst:.1e} N/m on the diagonal")
    ends = {kind: (part["gain_position"].max() - neutral, neutral - part["gain_position"].min())
            for kind, part in parts.items()}
    yield finding(all(max(ends["κ_2"][i], ends["κ_3"][i]) < ends["κ_4"][i] for i in (0, 1)),
                  "the fourth cumulant reaches the highest and lowest gains",
                  ", ".join(f"{kind}: {up:+.4f} {0.0 - down:+.4f} N/m" for kind, (up, down) in ends.items()))


def _balance():
    """Equal sources of opposite attitude; weights (4.36) with gamma_r = theta^(r-1)/r! of one order alone."""
    rows = []
    for setting, theta, root in ((PRINTED, 0.005, 2e-3), (PRINTED, THETA, 2e-3), (STORED, THETA, EDGE),
                                 (STORED, 0.02, EDGE)):
        pair, row = (root, root), {"setting": setting.label, "theta": theta, "sigma_sqrt": root}
        row["expected_cost"] = _gains.neutral(setting).position
        row["risk_sensitive"] = _gains.risk_sensitive(setting, pair, (theta, -theta)).position
        for order, name in zip(ORDERS, ("mean_variance", "third_cumulant", "fourth_cumulant")):
            weight = theta ** (order - 1) / math.factorial(order)
            row[name] = _gains.cumulants(setting, pair, order, (weight, -weight), False).position
        rows.append(row)
    return pd.DataFrame(rows)


def _closeness():
    """One averse source at the right edge: how far mean-variance is from risk-sensitive, as a share of its effect."""
    neutral, rows = _gains.neutral(STORED).position, []
    for theta in (0.0005, THETA, 0.005, 0.02):
        risk = _gains.risk_sensitive(STORED, (EDGE, EDGE / 2), (theta, -theta)).position
        row = {"theta": theta, "expected_cost": neutral, "risk_sensitive": risk}
        for name, gamma, printed in (("half_theta_with_r", theta / 2, False), ("half_theta_without_r", theta / 2, True),
                                     ("theta_without_r", theta, True)):
            row[name] = _gains.cumulants(STORED, (EDGE, EDGE / 2), 2, (gamma, -gamma), printed).position
        for name in ("half_theta_with_r", "half_theta_without_r"):
            row[f"{name}_off"] = abs(row[name] - risk) / abs(risk - neutral)
        rows.append(row)
    return pd.DataFrame(rows)


def _closeness_findings(close):
    where = f"Σ^1/2 = {EDGE:g} and {EDGE / 2:g}, {STORED.label}"
    small = close[close["theta"] == THETA].iloc[0]
    yield finding(small["half_theta_with_r_off"] < AGREES,
                  "mean-variance with gamma_2 = theta/2 is almost risk-sensitive, factor r kept (4.36)",
                  f"off by {small['half_theta_with_r_off']:.1%} of the effect at θ = {THETA:g}; {where}")
    yield finding(small["half_theta_without_r_off"] < AGREES,
                  "mean-variance with gamma_2 = theta/2 is almost risk-sensitive, without the factor r (4.37)",
                  f"off by {small['half_theta_without_r_off']:.1%}; gamma_2 = theta is needed there, as in the script")
    off = close["half_theta_with_r_off"]
    yield finding(off.is_monotonic_increasing, "the agreement holds for small theta only",
                  ", ".join(f"θ = {theta:g}: off by {share:.1%}" for theta, share in zip(close["theta"], off)))
