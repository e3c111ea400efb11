r"""Thirty digits of the facts: the closed forms once more, by mpmath and from the docstrings, with 50 digits.

    python benchmarks/digits.py

writes lcpimpact/truth/digits.csv, from which the files of truths take their decimals. Parameters are read as decimals, so
that 9.81 is 9.81 and not the nearest double. Systems 1 to 3 are flows by matrix exponentials from switch to switch. A test
computes the file again, and compares each line with the registry, whose values are computed in doubles by other code.
"""

from __future__ import annotations

import csv
from pathlib import Path

from mpmath import mp, mpf

from lcpimpact.files import whole_file
from lcpimpact.problems import load_problem

CSV = Path(__file__).parent.parent / "lcpimpact" / "truth" / "digits.csv"

DIGITS = 30


def parameters(name: str) -> dict[str, mpf]:
    """Return the default parameters of a problem as decimals."""
    return {key: mpf(repr(float(value))) for key, value in load_problem(name).parameters.items()}


def bouncing_ball(m, g, H, e):
    """Return the facts of bouncing-ball."""
    fall, v = mp.sqrt(2 * H / g), mp.sqrt(2 * g * H)
    return {
        "t_1": fall, "v_1": v, "v_3": e**2 * v, "t_3": fall * (1 + 2 * e + 2 * e**2), "t_∞": fall * (1 + e) / (1 - e),
    }  # fmt: skip


def ball_in_air(m, g, c, H, e):
    """Return the facts of ball-in-air."""
    top, t, h, found = mp.sqrt(m * g / c), mpf(0), H, {}
    for n in (1, 2, 3):
        v = top * mp.sqrt(1 - mp.exp(-2 * g * h / top**2))
        t += top / g * mp.acosh(mp.exp(g * h / top**2))
        found |= {f"t_{n}": t} | ({f"v_{n}": v} if n < 3 else {})
        t += top / g * mp.atan(e * v / top)
        h = top**2 / (2 * g) * mp.log(1 + (e * v / top) ** 2)
    return found


def kelvin_voigt_impact(m, k, c, v0):
    """Return the facts of kelvin-voigt-impact."""
    ω, ζ = mp.sqrt(k / m), c / (2 * mp.sqrt(k * m))
    root, φ = mp.sqrt(1 - ζ**2), mp.acos(ζ)
    return {
        "R(0+)": c * v0, "t_c": 2 * φ / (ω * root), "e": mp.exp(-2 * ζ * φ / root),
        "R_max": m * ω * v0 * mp.exp(-ζ * (3 * φ - mp.pi) / root), "x_max": v0 / ω * mp.exp(-ζ * φ / root),
    }  # fmt: skip


def kelvin_voigt_tension(m, k, c, v0):
    """Return the facts of kelvin-voigt-tension."""
    ω, ζ = mp.sqrt(k / m), c / (2 * mp.sqrt(k * m))
    root = mp.sqrt(1 - ζ**2)
    e = mp.exp(-mp.pi * ζ / root)
    return {"t_c": mp.pi / (ω * root), "e": e, "R(t_c)": -c * e * v0}


def maxwell_impact(m, k, c, v0):
    """Return the facts of maxwell-impact."""
    a = k / (2 * c)
    ω_d = mp.sqrt(k / m - a**2)
    e, top = mp.exp(-a * mp.pi / ω_d), mp.atan(ω_d / a) / ω_d
    R = k * v0 / ω_d * mp.exp(-a * top) * mp.sin(ω_d * top)
    return {"t_c": mp.pi / ω_d, "e": e, "R_max": R, "s": m * v0 * (1 + e) / c}


def oscillator_stop(m, k, e, v0):
    """Return the facts of oscillator-stop."""
    ω = mp.sqrt(k / m)
    return {"t_1": mp.pi / ω, "t_3": 3 * mp.pi / ω, "v_3": e**3 * v0, "x_min": v0 / ω}


def bilinear_oscillator(m, k, k_1, v0):
    """Return the facts of bilinear-oscillator."""
    ω_1, ω_2 = mp.sqrt(k / m), mp.sqrt((k + k_1) / m)
    return {
        "T": mp.pi / ω_1 + mp.pi / ω_2, "π/ω_2": mp.pi / ω_2, "x_max": v0 / ω_2, "x_min": -v0 / ω_1,
        "R_max": k_1 * v0 / ω_2,
    }  # fmt: skip


def two_ball_drop(m1, m2, g, H, e, delta):
    """Return the facts of two-ball-drop."""
    t_1, v = mp.sqrt(2 * H / g), mp.sqrt(2 * g * H)
    τ = delta / ((1 + e) * v)
    v_2 = g * τ + v * (m2 - m1 * (2 * e + e**2)) / (m1 + m2)
    return {"t_1": t_1, "v": v, "t_2": t_1 + τ, "v_2": v_2}


def pi_billiard(m, M, v0, D, d):
    """Return the facts of pi-billiard."""
    root = mp.sqrt(m / M)
    θ = mp.atan(root)
    N = int(mp.ceil(mp.pi / θ)) - 1
    times = {n: (D + d - d * root * mp.cot(n * θ)) / v0 for n in (1, 2, N)}
    V = -mp.cos(mp.pi - 2 * mp.ceil(mpf(N) / 2) * θ)
    return {"N": mpf(N), "t_1": times[1], "t_2": times[2], "t_N": times[N], "V/v0": V}


def hertz_impact(m, K, n, v0):
    """Return the facts of hertz-impact."""
    δ = ((n + 1) * m * v0**2 / (2 * K)) ** (1 / (n + 1))
    T = 2 / (n + 1) * mp.beta(1 / (n + 1), mpf(1) / 2) * δ / v0
    return {"δ_max": δ, "T": T, "F_max": K * δ**n}


def hunt_crossley_impact(m, K, b, n, v0):
    """Return the facts of hunt-crossley-impact."""
    a = b * v0
    lost = a - mp.log(1 + a)
    δ = ((n + 1) * m * lost / (K * b**2)) ** (1 / (n + 1))
    e = (1 + mp.lambertw(-(1 + a) * mp.exp(-(1 + a))).real) / a
    w = mp.findroot(lambda w: n * w + (n + 1) * (w - mp.log(1 + w) - lost), a / 2)
    at = ((n + 1) * m * (lost - w + mp.log(1 + w)) / (K * b**2)) ** (1 / (n + 1))
    return {"δ_max": δ, "e": e, "F_max": K * at**n * (1 + w)}


def forced_coulomb_oscillator(m, k, F, P, omega):
    """Return the facts of forced-coulomb-oscillator."""
    ω_n = mp.sqrt(k / m)
    β, x_f, a = omega / ω_n, F / k, P / k
    V, U = 1 / (1 - β**2), mp.sin(mp.pi / β) / (β * (1 + mp.cos(mp.pi / β)))
    X, t = mp.sqrt(V**2 * a**2 - U**2 * x_f**2), mp.pi / (4 * omega)
    free = x_f * (1 - mp.cos(ω_n * t) - β * U * mp.sin(ω_n * t))
    return {
        "X": X, "x(T/8)": free + X * mp.cos(omega * t) + U * x_f * mp.sin(omega * t), "T/2": mp.pi / omega,
    }  # fmt: skip


def stick_slip_belt(m, g, k, mu, mu_s, v_b):
    """Return the facts of stick-slip-belt."""
    ω, x_s, Δ = mp.sqrt(k / m), mu * m * g / k, (mu_s - mu) * m * g / k
    t_st = 2 * Δ / v_b
    T = t_st + 2 / ω * (mp.pi - mp.atan(ω * Δ / v_b))
    return {"t_st": t_st, "T": T, "x_max": x_s + mp.sqrt(Δ**2 + (v_b / ω) ** 2)}


def vibrating_table(m, g, e, A, omega, n):
    """Return the facts of vibrating-table."""
    # The default of ω is 20 π.
    T = 2 * mp.pi * n / (20 * mp.pi)
    w = g * T / 2 * (1 - e) / (1 + e)
    return {"T": T, "w": w, "U": g * T / (1 + e), "P": m * g * T}


def plastic_ball(m, g, A, omega):
    """Return the facts of plastic-ball."""
    ω = 20 * mp.pi
    Γ = A * ω**2 / g
    θ = mp.acos(-1 / Γ)

    def gap(s):
        return Γ * (mp.cos(θ + s) - mp.cos(θ) + mp.sin(θ) * s) - s**2 / 2

    s = mp.findroot(gap, float(load_problem("plastic-ball").facts[1].value * 62.83185307179586 - float(θ)))
    U = g / ω * (s - Γ * (mp.sin(θ) - mp.sin(θ + s)))
    return {"t_1": θ / ω, "t_2": (θ + s) / ω, "U": U}


def filippov(f0, s, depth):
    """Return the facts of filippov."""
    t_1 = (f0 + 1 - mp.sqrt((f0 + 1) ** 2 - 2 * s * depth)) / s
    return {"t_1": t_1, "t_2": 2 * (f0 - 1) / s - t_1, "t_3": (f0 + 1) / s}


def sliding_mode(a, d, c, x0):
    """Return the facts of sliding-mode."""
    t_s = (mp.sqrt(1 + 2 * c**2 * x0 / (a - d)) - 1) / c
    x_s = x0 - (a - d) * t_s**2 / 2
    return {"t_s": t_s, "x_s": x_s, "x": x_s * mp.exp(-3), "λ": (d - c * c * x_s * mp.exp(-3)) / a}


def relay_oscillator(a, x0):
    """Return the facts of relay-oscillator."""
    quarter = mp.sqrt(2 * x0 / a)
    return {"t_1": quarter, "v_1": -mp.sqrt(2 * a * x0), "t_2": 3 * quarter}


def twisting(r1, r2, x0):
    """Return the facts of twisting."""
    inwards, outwards = r1 - r2, r1 + r2
    τ = mp.sqrt(2 * x0) * (1 / mp.sqrt(inwards) + mp.sqrt(inwards) / outwards)
    return {
        "t_1": mp.sqrt(2 * x0 / inwards), "x_1": -x0 * inwards / outwards, "t_∞": τ / (1 - mp.sqrt(inwards / outwards)),
    }  # fmt: skip


def reflected_motion(A, omega, x0):
    """Return the facts of reflected-motion."""
    return {"t_1": (mp.pi + mp.asin(omega * x0 / A)) / omega, "t_2": 3 * mp.pi / (2 * omega)}


def system(name, m, k_o, c_o, g, h_o, v_o=None, k=None, c=None):
    """Return the facts of Systems 1 to 3, X' = A X + b + B R and u = C X + D R; k is None in System 1, c in System 2."""
    v_o = mp.sqrt(2 * g * h_o)
    n = 4 if c is not None else 3
    A, b, B, C = mp.zeros(n), mp.zeros(n, 1), mp.zeros(n, 1), mp.matrix([[-1, 0, 1, -1][:n]])
    A[0, 1], A[2, 2], b[1], B[1], B[2] = 1, -k_o / c_o, g, -1 / m, 1 / c_o
    if n == 4:
        A[3, 3], B[3] = -k / c, -1 / c
    X = mp.zeros(n, 1)
    X[1] = v_o
    # In contact R = r X + r_0: u = 0 with D = 1/k in System 2, and u' = 0 in the others.
    if name == "system-2":
        r, r_0 = -k * C, mpf(0)
    else:
        scale = (C * B)[0]
        r, r_0 = -(C * A) / scale, -(C * b)[0] / scale

    def flow(closed, X, t):
        """Return X after t, by the exponential of the matrix of X and 1."""
        Z = mp.zeros(n + 1)
        field, push = (A + B * r, b + B * r_0) if closed else (A, b)
        for i in range(n):
            Z[i, n] = push[i]
            for j in range(n):
                Z[i, j] = field[i, j]
        return (mp.expm(Z * t) * mp.matrix([*X, 1]))[:n]

    def force(X):
        return (r * mp.matrix(X))[0] + r_0

    def rate(X):
        return (r * ((A + B * r) * mp.matrix(X) + b + B * r_0))[0]

    known = {each.symbol: each.value for each in load_problem(name).facts}
    switches = sorted(value for symbol, value in known.items() if symbol.startswith("t_"))
    found, begun, closed, tops = {"R(0+)": force(X)}, mpf(0), True, [force(X)]
    for i, near in enumerate([*switches, 3.0]):
        at = [mpf(near) - begun]
        if near < 3.0:
            ends = force if closed else (lambda X: (C * mp.matrix(X))[0])
            at = [mp.findroot(lambda t, X=X, ends=ends, closed=closed: ends(flow(closed, X, t)), at[0])]
        if closed:  # the maximum lies between two of these instants, if it is not at an end
            grid = [at[0] * j / 40 for j in range(41)]
            heights = [force(flow(True, X, t)) for t in grid]
            j = heights.index(max(heights))
            tops.append(heights[j])
            if 0 < j < 40:
                top = mp.findroot(lambda t, X=X: rate(flow(True, X, t)), (grid[j - 1], grid[j + 1]), solver="anderson")
                tops.append(force(flow(True, X, top)))
        X, begun = mp.matrix(flow(closed, X, at[0])), begun + at[0]
        if near < 3.0:
            found[f"t_{i + 1}"], closed = begun, not closed
    found |= {"R_max": max(tops), "x(3)": X[0], "R(3)": force(X) if closed else mpf(0)}
    return {symbol: value for symbol, value in found.items() if symbol in known}


FORMS = {
    "bouncing-ball": bouncing_ball, "ball-in-air": ball_in_air, "kelvin-voigt-impact": kelvin_voigt_impact,
    "kelvin-voigt-tension": kelvin_voigt_tension, "maxwell-impact": maxwell_impact, "oscillator-stop": oscillator_stop,
    "bilinear-oscillator": bilinear_oscillator, "two-ball-drop": two_ball_drop, "pi-billiard": pi_billiard,
    "hertz-impact": hertz_impact, "hunt-crossley-impact": hunt_crossley_impact,
    "forced-coulomb-oscillator": forced_coulomb_oscillator, "stick-slip-belt": stick_slip_belt,
    "vibrating-table": vibrating_table, "plastic-ball": plastic_ball, "filippov": filippov, "sliding-mode": sliding_mode,
    "relay-oscillator": relay_oscillator, "twisting": twisting, "reflected-motion": reflected_motion,
}  # fmt: skip


def decimals() -> list[tuple[str, str, str]]:
    """Return problem, fact and decimal of all that is known to thirty digits."""
    with mp.workdps(50):
        found = {f"system-{i}": system(f"system-{i}", **parameters(f"system-{i}")) for i in (1, 2, 3)}
        found |= {name: form(**parameters(name)) for name, form in FORMS.items()}
        return [
            (name, symbol, mp.nstr(value, DIGITS, strip_zeros=False, min_fixed=-5, max_fixed=DIGITS))
            for name, facts in found.items()
            for symbol, value in facts.items()
            if value != 0
        ]


if __name__ == "__main__":
    with whole_file(CSV) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([("problem", "fact", "value"), *decimals()])
