"""Studies that need the dynamics of a Scheme refuse a SparseScheme in one sentence, with the remedy."""

import pytest

import lcpimpact as li

FALLING = li.Problem(
    "falling",
    li.SparseScheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.Bumper("x", "ground", gap=1.0, e=0.5, name="R")),
    t_end=0.5,
)

STUDIES = {
    "cross_validate": lambda folder: li.cross_validate(FALLING, progress=False),
    "poincare": lambda folder: li.poincare(FALLING, progress=False),
    "periodic_orbit": lambda folder: li.periodic_orbit(FALLING),
    "continue_orbit": lambda folder: li.continue_orbit(lambda value: FALLING, [1.0, 2.0]),
    "lyapunov": lambda folder: li.lyapunov(FALLING),
    "sweep": lambda folder: li.sweep(FALLING, {"k": [1.0]}, dt=1e-2),
    "energy_ledger": lambda folder: li.energy_ledger(li.simulate(FALLING, dt=1e-2, progress=False)),
    "explore": lambda folder: li.explore(FALLING, folder / "page.html"),
}


@pytest.mark.parametrize("study", STUDIES)
def test_a_study_refuses_a_sparse_scheme_and_says_what_to_take(study, tmp_path):
    with pytest.raises(li.UnsupportedError, match=r"take Scheme\(\.\.\., format='full'\)"):
        STUDIES[study](tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_sparse_scheme_is_converged():
    study = li.convergence(FALLING, ["moreau-jean"], [1e-2, 5e-3], progress=False)
    assert len(study.table) == 2
