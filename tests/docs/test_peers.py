"""The table of other programs' examples names what there is, and the page is the one that its script writes."""

import re

import pandas as pd
import pytest
from peers_page import EXAMPLES, MEASURED, PAGE, page

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
    told = TABLE[TABLE["how"].str.contains("measured below")]
    assert len(told) == len(measured)
    assert (told["fits"] == "yes").all()
    alike = ~measured["tutorial"].isin(["CircuitRLCD", "DiodeBridge"])
    assert (measured.loc[alike, "difference"] < 1e-9).all()
    assert alike.sum() == len(measured) - 2
