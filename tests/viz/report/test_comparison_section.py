"""A comparison of tuning methods on the report's page."""

import html
import json
from shutil import copytree, rmtree

import pytest

from optim.comparison import tables
from spacerobot.common.errors import ResultError
from viz.report.comparison_section import comparison_report, comparison_section


@pytest.fixture(scope="module")
def whole(make_comparison, tmp_path_factory):
    return make_comparison(tmp_path_factory.mktemp("whole"), {"kp": 7.0}, ["kp"])


@pytest.fixture
def folder(whole, tmp_path):
    return copytree(whole, tmp_path / "comparison")


def test_the_verdict_comes_first_and_then_what_each_method_found(undrawn, folder):
    page = comparison_report(folder)
    for text in (
        "untuned and nlp",
        "300",
        "250",
        "123",
        "5",
        "9",
        "3.25",
        "7*",
        "4.69",
        "308 (310..310)*",
        "4/5 = 0.80",
    ):
        assert text in page
    assert page.index("nlp is ahead") < page.index("<table")
    for title in (
        "Data profiles",
        "All runs of each method",
        "Objective on plants that differ from the tuned one",
    ):
        assert title in page
    assert "How far the objective moves" not in page


def test_without_designs_it_is_a_page_of_its_own(undrawn, folder):
    rmtree(folder / "base-five" / "nlp")
    page = comparison_report(folder)
    assert "nlp is ahead" in page
    assert "Headline numbers" not in page


def test_names_from_files_are_escaped(undrawn, folder):
    for text in (comparison_section(folder).body(None), comparison_report(folder)):
        assert "ahead <b>" not in text
        assert "ahead &lt;b&gt;" in text


def test_a_best_design_whose_ledger_is_open_is_marked_in_tables_and_on_the_page(undrawn, folder):
    file = folder / "comparison.json"
    data = json.loads(file.read_text())
    data["problems"][0]["methods"]["nlp"]["best"] |= {
        "trusted": False,
        "open": ["momentum drift 32 % linear"],
    }
    file.write_text(json.dumps(data))
    told = "the ledger of nlp's best is open (momentum drift 32 % linear): do not trust it"
    assert any(told in line for line in tables.caveats(data["problems"][0]))
    assert told in tables.markdown({**data, "problems": data["problems"][:1]})
    page = comparison_report(folder)
    assert html.escape(told) in page
    assert page.count("(ledger open)") == 1


def test_a_best_design_whose_contacts_are_too_deep_is_marked_likewise(undrawn, folder):
    file = folder / "comparison.json"
    data = json.loads(file.read_text())
    deep = ["contact bump is 96 mm deep, where its smaller shape has 50 mm from its middle to its surface"]
    data["problems"][0]["methods"]["nlp"]["best"] |= {"trusted": False, "open": [], "deep": deep}
    file.write_text(json.dumps(data))
    told = f"bodies pass into each other in nlp's best ({deep[0]}): do not trust it"
    assert [told in line for line in tables.caveats(data["problems"][0])] == [True]
    page = comparison_report(folder)
    assert html.escape(told) in page
    assert page.count("(too deep)") == 1


@pytest.mark.parametrize("content", ["", "{}", '{"problems": [{}]}', '{"problems": 3}'])
def test_a_broken_comparison_is_one_clear_line(undrawn, folder, content):
    (folder / "comparison.json").write_text(content)
    with pytest.raises(
        ResultError, match=r"comparison\.json: damaged: .*run `spacerobot compare` with the same"
    ):
        comparison_report(folder)
