"""The table of other programs' examples names what there is, and the page is the one that its script writes."""

import re

import pandas as pd
import pytest
from peers_page import EXAMPLES, MEASURED, NEWER, PAGE, page

import lcpimpact
from lcpimpact.integrators import METHODS
from lcpimpact.problems import PROBLEMS

TABLE = pd.read_csv(EXAMPLES, keep_default_na=False)


def test_the_page_is_the_one_that_its_script_writes():
    assert PAGE.read_text(encoding="utf-8") == page()


def test_each_example_is_named_once():
    assert not TABLE.duplicated(["peer", "example"]).any()
    assert set(TABLE["fits"]) == {"yes", "partly", "no"}
    assert set(TABLE["peer"]) == {"Siconos", "nosnoc", "cardillo"}


@pytest.mark.parametrize("row", TABLE.to_dict("records"), ids=lambda row: f"{row['peer']}, {row['example']}")
def test_a_row_names_what_there_is(row):
    assert [name for name in row["problems"].split() if name not in PROBLEMS] == []
    public = {name.partition(".")[0] for name in re.findall(r"`([^`]+)`", row["how"])} - {"validate"}
    assert [name for name in public if name not in lcpimpact.__all__ and name not in METHODS] == []
    assert row["problems"] or row["how"]
    assert row["fits"] != "yes" or row["problems"] or public or "validate" in row["how"], (
        "an example that fits, as what?"
    )


def test_what_is_called_measured_was_measured():
    measured = pd.read_csv(MEASURED)
    for peer, rows in TABLE.groupby("peer"):
        told = [name for names in rows["measured"] if names for name in names.split(";")]
        assert sorted(told) == sorted(measured.loc[measured["peer"] == peer, "example"])
    assert (TABLE.loc[TABLE["measured"] != "", "fits"] != "no").all()


@pytest.mark.parametrize(
    ("peer", "others"),
    [
        (
            "Siconos",
            "CircuitRLCD DiodeBridge DiodeBridgeCapFilter DiodeBridgeCapFilter-ThetaGammaSchemes DiodeBridgePowSup PRC "
            "train_tslcp BallOnMovingPlane",
        ),
        ("cardillo", "two_mass_oscillator double_pendulum friction_belt"),
    ],
)
def test_the_steps_of_both_are_the_same_but_where_the_page_says_why(peer, others):
    measured = pd.read_csv(MEASURED).query("peer == @peer").set_index("example")["difference"]
    other = measured.index.isin(others.split())
    assert other.sum() == len(others.split())
    assert (measured[~other] < 1e-9).all()


def test_no_error_here_is_far_above_that_of_the_other_program_but_one_of_which_the_page_tells():
    measured = pd.read_csv(MEASURED)
    worse = measured["error"] > 2.0 * measured["error_theirs"].clip(lower=1e-8)
    assert measured.loc[worse, "example"].tolist() == ["DiodeBridgePowSup"]


def test_a_newer_version_takes_the_steps_of_the_older():
    measured = pd.read_csv(MEASURED).set_index("example")
    for older, newer in NEWER.items():
        steps = [measured.loc[measured["peer"] == peer, "difference"] for peer in (older, newer)]
        common = steps[1].index
        assert len(common) >= 20
        assert set(common) <= set(steps[0].index)
        assert (abs(steps[1] - steps[0][common]) < 1e-9).all()
