"""Plain formulas of docstrings become TeX; prose, units and code stay."""

import pytest
from tex import tex, with_tex


@pytest.mark.parametrize(
    ("plain", "expected"),
    [
        ("0 <= P ⟂ U⁺ + e U⁻ >= 0", r"0 \le P \perp U^+ + e U^- \ge 0"),
        ("w = w_free + A⁻¹ Hᵀ r", r"w = w_{\mathrm{free}} + A^{-1} H^T r"),
        ("e = exp(-2 ζ acos ζ/sqrt(1 - ζ²))", r"e = \exp(-2 \zeta \arccos \zeta/\sqrt{1 - \zeta^2})"),
        ("δ_maxⁿ⁺¹ = (n + 1) m (a - ln(1 + a))/(K b²)", r"\delta_{\max}^{n+1} = (n + 1) m (a - \ln(1 + a))/(K b^2)"),
        ("p_(n+1) = h p_n - e p_(n-1)", r"p_{n+1} = h p_n - e p_{n-1}"),
        ("((1 + e)/2)^(N-1)", r"((1 + e)/2)^{N-1}"),
        (
            "f* = |s| sqrt((1 - ω²)² + (2 ζ ω)²)",
            r"f^\ast = \lvert s\rvert \sqrt{(1 - \omega^2)^2 + (2 \zeta \omega)^2}",
        ),
        ("R(t) = ∫ G(t - s) x'(s) ds", r"R(t) = \int G(t - s) x'(s) \, \mathrm{d}s"),
        ("lower <= z_i <= upper", r"\mathrm{lower} \le z_i \le \mathrm{upper}"),
        ("k_inf = +r_0 + √2 M_·j", r"k_\infty = +r_0 + \sqrt{2} M_{\cdot j}"),
        ("abs(m1 v0) <= 1e-9", r"\lvert m_1 v_0\rvert \le 10^{-9}"),
    ],
)
def test_a_formula(plain: str, expected: str) -> None:
    assert tex(plain) == expected


@pytest.mark.parametrize(
    "text", ["load_problem(name)", 'contact="clip"', "(1 + e", "1 +", "max_steps", "", "a formula"]
)
def test_what_is_no_formula(text: str) -> None:
    with pytest.raises(ValueError, match="no formula"):
        tex(text)


@pytest.mark.parametrize(
    "text",
    [
        "A body falls 0.5 m in 3 s: a P-matrix, an L-shaped one, and a step (1) or (2).",
        "Stiffness in N/m, damping in N s/m and mass in kg; gravity in m/s² and height in m.",
        "See ``simulate(problem, dt=1e-3)``, `system_1`, [q](#q), $x$ and $$v = 0$$",
        'Columns "x" and v_NAME (m/s), NAME.F1 in m or m/s, shapes (2, 3); ahead of the lower plate; Eq. (2c).',
        "Schwager and Pöschel (2007), section I.2.",
    ],
)
def test_prose_stays(text: str) -> None:
    assert with_tex(text) == text


def test_formulas_in_prose() -> None:
    assert with_tex("A step of h with A w = b, where a = b v0; at the n-th\nimpact U⁺ =\n-e U⁻ (θ = 1/2).") == (
        "A step of $h$ with $A w = b$, where $a = b v_0$; at the $n$-th\nimpact $U^+ = -e U^-$ ($\\theta = 1/2$)."
    )


def test_names_of_bounds_in_prose() -> None:
    assert with_tex("The gap u := slack - x, Σ ½ m v², of the lower where z > lower (m, of x).") == (
        "The gap $u := \\mathrm{slack} - x$, $\\sum \\tfrac12 m v^2$, of the lower where $z > \\mathrm{lower}$ (m, of $x$)."
    )
